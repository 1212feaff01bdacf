// Turning, moving and approaching by pointer, wheel and keys.

import { Vector3 } from './three.min.js';

/** What a key does: how far round, how far up, how much nearer. */
const KEYS = {
  ArrowLeft: [-0.1, 0, 1], ArrowRight: [0.1, 0, 1], ArrowUp: [0, -0.1, 1], ArrowDown: [0, 0.1, 1],
  '+': [0, 0, 0.9], '-': [0, 0, 1.1],
};

export class Orbit {
  constructor(eye, canvas, changed) {
    Object.assign(this, { eye, changed, pointers: new Map() });
    this.target = new Vector3(0, 0.9, -3.2);
    Object.assign(this, { distance: 6.2, azimuth: 0.5, polar: 1.2 });
    canvas.addEventListener('contextmenu', (e) => e.preventDefault());
    canvas.addEventListener('pointerdown', (e) => {
      canvas.setPointerCapture(e.pointerId);
      this.pointers.set(e.pointerId, [e.clientX, e.clientY]);
    });
    const up = (e) => this.pointers.delete(e.pointerId);
    canvas.addEventListener('pointerup', up);
    canvas.addEventListener('pointercancel', up);
    canvas.addEventListener('pointermove', (e) => this.drag(e, canvas.clientHeight));
    canvas.addEventListener('wheel', (e) => {
      e.preventDefault();
      this.approach(Math.exp(e.deltaY * 0.001));
    }, { passive: false });
    canvas.addEventListener('keydown', (e) => this.press(e));
    this.apply();
  }

  /** Arrows turn with Shift; without it they go from frame to frame. */
  press(e) {
    const key = KEYS[e.key];
    if (!key || e.altKey || e.ctrlKey || e.metaKey || (e.key.startsWith('Arrow') && !e.shiftKey)) return;
    const [round, up, nearer] = key;
    this.turn(round, up);
    this.approach(nearer);
    e.preventDefault();
    e.stopPropagation();
  }

  turn(round, up) {
    this.azimuth += round;
    this.polar = Math.min(1.57, Math.max(0.05, this.polar + up));
  }

  /** Looks so much higher. */
  lift(metres) {
    this.target.y += metres;
    this.apply();
  }

  drag(e, height) {
    const before = this.pointers.get(e.pointerId);
    if (!before) return;
    const spread = this.spread();
    const [dx, dy] = [e.clientX - before[0], e.clientY - before[1]];
    this.pointers.set(e.pointerId, [e.clientX, e.clientY]);
    if (this.pointers.size > 1) this.approach(spread / Math.max(1, this.spread()));
    if (this.pointers.size > 1 || e.buttons === 2 || e.shiftKey) {
      const metres = this.distance / height / this.pointers.size;
      const [side, up] = [new Vector3(), new Vector3()];
      this.eye.matrix.extractBasis(side, up, new Vector3());
      this.target.addScaledVector(side, -dx * metres).addScaledVector(up, dy * metres);
    } else {
      this.turn(-(dx / height) * 3, -(dy / height) * 3);
    }
    this.apply();
  }

  spread() {
    const [a, b] = [...this.pointers.values()];
    return b ? Math.hypot(a[0] - b[0], a[1] - b[1]) : 1;
  }

  approach(factor) {
    this.distance = Math.min(60, Math.max(0.5, this.distance * factor));
    this.apply();
  }

  apply() {
    const { eye, target, distance, azimuth, polar } = this;
    const flat = distance * Math.sin(polar);
    eye.position.set(flat * Math.sin(azimuth), distance * Math.cos(polar), flat * Math.cos(azimuth)).add(target);
    eye.lookAt(target);
    eye.updateMatrix();
    this.changed();
  }
}
