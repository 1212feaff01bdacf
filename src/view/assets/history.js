// The last minute of every camera, or all of a record: what came, and which frame is shown.

const KEEP_NS = 60e9;
/** The way to a frame that is held. */
const HELD_NS = 10e9;

export class History {
  constructor() {
    this.cameras = new Map();
    /** How much of the past is kept, nanoseconds. */
    this.keepNs = KEEP_NS;
    this.held = null;
  }

  /** Adds a frame. A camera that starts anew has no past. */
  add(frame) {
    let frames = this.cameras.get(frame.camera);
    if (!frames) this.cameras.set(frame.camera, (frames = []));
    if (frames.length > 0 && frame.publishNs < frames.at(-1).publishNs) frames.length = 0;
    frames.push(frame);
    let old = 0;
    while (frame.publishNs - frames[old].publishNs > this.keepNs) old++;
    const kept = frames.slice(0, old).filter((f) => this.holds(f));
    if (old > kept.length) frames.splice(0, old, ...kept);
  }

  /** Lets go of a camera's frames from this one on, which come again. */
  rewind(frame) {
    const frames = this.frames(frame.camera);
    const first = frames.findIndex((f) => f.publishNs >= frame.publishNs);
    if (first >= 0) frames.length = first;
  }

  /** Keeps a frame, and what came shortly before it, however old it becomes; null: none. */
  hold(frame) {
    this.held = frame;
  }

  holds(frame) {
    const ago = this.held?.camera === frame.camera ? this.held.publishNs - frame.publishNs : -1;
    return ago >= 0 && ago <= HELD_NS;
  }

  /** The time between a camera's last frames, nanoseconds; the shorter of two: one pause makes no slow camera. */
  interval(camera) {
    const [a, b, c] = this.frames(camera).slice(-3).map((f) => f.publishNs);
    return c === undefined ? 0 : Math.min(b - a, c - b);
  }

  frames(camera) {
    return this.cameras.get(camera) ?? [];
  }

  /** Index of the last frame at or before a time; 0 before the first. */
  indexAt(camera, publishNs) {
    const frames = this.frames(camera);
    let [low, high] = [0, frames.length];
    while (low < high) {
      const middle = (low + high) >> 1;
      if (frames[middle].publishNs <= publishNs) low = middle + 1;
      else high = middle;
    }
    return Math.max(0, low - 1);
  }
}
