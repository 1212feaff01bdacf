// The tables beside the picture.

import { PELVIS } from './decode.js';
import { colourOf, inWorld } from './space.js';

const EVERY_MS = 150;
const TIMES = [
  ['letterbox', 'letterbox'], ['stage1', 'Stage I'], ['association', 'people'], ['stage2', 'Stage II'], ['fit', 'fit'],
];

export class Panel {
  constructor() {
    this.people = document.querySelector('#people tbody');
    this.place = document.querySelector('#place');
    this.times = document.querySelector('#times tbody');
    this.written = 0;
  }

  /** Writes the tables, a few times a second: nobody reads faster. Whether it has. */
  show(frame, frames, index, now) {
    if (now - this.written < EVERY_MS) return false;
    this.written = now;
    // Several cameras have one room, whose origin is where the calibration has put it.
    const isRoom = frame.width === 0;
    this.place.textContent = isRoom ? 'at x, z' : 'away';
    rows(this.people, frame.bodies.map((body) => {
      return [
        [`#${body.id}`, `#${colourOf(body.id).getHexString()}`], [body.state], [`${Math.round(100 * body.score)} %`],
        [isRoom ? onFloor(frame, body) : away(body)], [`${body.height.toFixed(2)} m`],
        [`${Math.hypot(...body.velocity).toFixed(1)} m/s`],
      ];
    }));
    const all = Object.values(frame.times).reduce((sum, us) => sum + us, 0);
    const list = TIMES.map(([key, name]) => [[name], [ms(frame.times[key])]]);
    list.push([['all stages'], [ms(all)]]);
    if (!frame.isFile) list.push([['capture to publish'], [ms((frame.publishNs - frame.captureNs) / 1e3)]]);
    list.push([['frames a second'], [rate(frames, index)]], [['frame'], [String(frame.sequence)]]);
    if (!isRoom) {
      const height = frame.world.translation[1].toFixed(2);
      list.push([['floor'], [frame.world.known ? `${height} m below the camera` : 'not known yet']]);
    }
    rows(this.times, list);
    return true;
  }

  clear() {
    this.people.replaceChildren();
    this.times.replaceChildren();
  }
}

function pelvis(body) {
  return body.joints.subarray(3 * PELVIS, 3 * PELVIS + 3);
}

/** From the camera. */
function away(body) {
  return `${Math.hypot(...pelvis(body)).toFixed(2)} m`;
}

/** In the world, whose y points up. */
function onFloor(frame, body) {
  const { x, z } = inWorld(frame.world, pelvis(body));
  return `${x.toFixed(2)}, ${z.toFixed(2)} m`;
}

function ms(us) {
  return `${(us / 1000).toFixed(1)} ms`;
}

/** Frames of the last two seconds before a frame. */
function rate(frames, index) {
  const last = frames[index].publishNs;
  let first = index;
  while (first > 0 && last - frames[first - 1].publishNs < 2e9) first--;
  return first < index ? ((index - first) / ((last - frames[first].publishNs) / 1e9)).toFixed(1) : '–';
}

function rows(body, list) {
  body.replaceChildren(...list.map((cells) => {
    const row = document.createElement('tr');
    row.append(...cells.map(([text, colour]) => {
      const cell = document.createElement('td');
      cell.textContent = text;
      if (colour) cell.style.color = colour;
      return cell;
    }));
    return row;
  }));
}
