// How cameras are doing, as they say themselves: why no frames come.

import { keep } from './connections.js';

/** Who has said nothing for longer has gone, or hangs: each says something once a second. */
const STALE_MS = 5000;
const WORDS = {
  starting: () => 'the camera has sent no picture yet',
  stalled: (since) => `the camera has sent no picture since ${since}`,
  away: (since) => `the camera has been away since ${since}`,
};

/** What every camera said last. */
export class Health {
  constructor() {
    this.byCamera = new Map();
  }

  /** `url` takes a path to an address; a connection that is lost is made again. */
  connect(url) {
    keep(() => {
      const socket = new WebSocket(url('ws', 'health'));
      socket.onmessage = ({ data }) => this.take(JSON.parse(data));
      return socket;
    });
  }

  take(told) {
    const before = this.byCamera.get(told.camera);
    // By the clock, and once for each state: a line that changes every second is read out every second.
    const isSame = before?.since_ns === told.since_ns;
    const began = isSame ? before.began : Date.now() - (told.publish_ns - told.since_ns) / 1e6;
    this.byCamera.set(told.camera, { ...told, began, heard: performance.now() });
  }

  /** Why no frames of a camera come; null where it does not say. */
  why(camera) {
    const told = this.byCamera.get(camera);
    if (!told || performance.now() - told.heard > STALE_MS) return null;
    if (told.cameras > 1) {
      return told.cameras_live < told.cameras ? `${told.cameras_live} of ${told.cameras} cameras send` : null;
    }
    return WORDS[told.state]?.(new Date(told.began).toLocaleTimeString()) ?? null;
  }

  /** A camera that says why none come, and what it says; null: there is none. */
  any() {
    for (const camera of this.byCamera.keys()) {
      const why = this.why(camera);
      if (why) return `${camera}: ${why}`;
    }
    return null;
  }
}
