// What has happened, beside the picture: events as the server tells them.

import { keep } from './connections.js';
import { colourOf } from './space.js';

/** Events of a running camera; of a record all are. */
const KEPT = 500;
const SHOWN = 8;
const WORDS = {
  entered: () => 'came',
  left: (e) => `left after ${seconds(e)}`,
  came_back: (e) => `came back after ${seconds(e)}`,
  zone_entered: (e) => `stepped into ${e.zone}`,
  zone_left: (e) => `stepped out of ${e.zone} after ${seconds(e)}`,
  dwelt: (e) => `has been in ${e.zone} for ${seconds(e)}`,
  hand_raised: (e) => `raised the ${e.hand} hand`,
  hand_lowered: (e) => `lowered the ${e.hand} hand`,
  waved: (e) => `waved with the ${e.hand} hand`,
  main_person: (e) => (e.person === null ? 'nobody is the main person' : 'is the main person'),
};

/** Events of every camera; shows the newest before the frame that is shown. */
export class Happened {
  constructor(table) {
    const body = table.querySelector('tbody');
    Object.assign(this, { body, byCamera: new Map(), most: KEPT, changed: false, drawn: '' });
  }

  /** `url` takes a path to an address; a connection that is lost is made again. */
  connect(url) {
    keep(() => {
      const socket = new WebSocket(url('ws', 'events'));
      socket.onopen = () => {
        // Those of a record all come again.
        if (this.most === Infinity) this.byCamera.clear();
      };
      socket.onmessage = ({ data }) => this.take(JSON.parse(data));
      return socket;
    });
  }

  take(event) {
    const events = this.byCamera.get(event.camera) ?? [];
    // A run that begins again: its clock, too, if it plays a file.
    if (events.length > 0 && event.time_ns < events.at(-1).time_ns) events.length = 0;
    events.push(event);
    if (events.length > this.most) events.shift();
    this.byCamera.set(event.camera, events);
    this.changed = true;
  }

  /** A camera begins anew with this frame: what is later was before it. */
  begin(frame) {
    // A record begins once.
    if (this.most === Infinity) return;
    const events = this.byCamera.get(frame.camera) ?? [];
    this.byCamera.set(frame.camera, events.filter((e) => e.time_ns <= frame.poseNs));
    this.changed = true;
  }

  /** The newest at the time of a frame, the newest first. */
  until(frame) {
    const events = this.byCamera.get(frame.camera) ?? [];
    return events.filter((e) => e.time_ns <= frame.poseNs).slice(-SHOWN).reverse();
  }

  show(frame) {
    this.changed = false;
    const events = this.until(frame);
    const lines = events.map((e) => [`${Math.round((frame.poseNs - e.time_ns) / 1e9)} s ago`, e]);
    const drawn = lines.map(([ago, e]) => `${ago} ${e.frame} ${e.person} ${e.event}`).join();
    if (drawn === this.drawn) return;
    this.drawn = drawn;
    this.body.replaceChildren(...lines.map(([ago, event]) => row(ago, event)));
  }

  clear() {
    this.drawn = '';
    this.body.replaceChildren();
  }
}

function seconds(event) {
  return `${(event.seconds ?? 0).toFixed(1)} s`;
}

function row(ago, event) {
  const line = document.createElement('tr');
  const who = event.person === null ? '' : `#${event.person}`;
  line.append(...[who, WORDS[event.event]?.(event) ?? event.event, ago].map((text) => {
    const cell = document.createElement('td');
    cell.textContent = text;
    return cell;
  }));
  if (who) line.firstChild.style.color = `#${colourOf(event.person).getHexString()}`;
  return line;
}
