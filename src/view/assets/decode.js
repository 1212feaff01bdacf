// The compact form of a frame, as the server describes it: little-endian, every number at a fixed place.

export const JOINTS = 21;
/** Parent of every joint; the pelvis (14) is its own. */
export const PARENTS = [16, 15, 1, 2, 3, 1, 5, 6, 14, 8, 9, 14, 11, 12, 14, 14, 1, 4, 7, 10, 13];
export const PELVIS = 14;
export const HEAD = 16;
export const HEAD_TOP = 0;
const BODY_BYTES = 468;
const STATES = ['tentative', 'tracked', 'predicted'];

/** A frame of an ArrayBuffer; null of anything else. Numbers of joints are read in place: nothing is copied. */
export function decode(buffer) {
  const view = new DataView(buffer);
  if (buffer.byteLength < 128 || view.getUint32(0, false) !== 0x45434150 || view.getUint16(4, true) !== 1) return null;
  const long = (at) => Number(view.getBigUint64(at, true));
  const u32 = (at) => view.getUint32(at, true);
  const floats = (at, n) => new Float32Array(buffer, at, n);
  const nameBytes = u32(124);
  const camera = new TextDecoder().decode(new Uint8Array(buffer, 128, nameBytes));
  const bodies = [];
  let at = 128 + Math.ceil(nameBytes / 4) * 4;
  for (let n = view.getUint16(6, true); n > 0; n--, at += BODY_BYTES) {
    const [score, height] = floats(at + 8, 2);
    bodies.push({
      id: u32(at),
      state: STATES[view.getUint8(at + 4)] ?? STATES[0],
      score,
      height,
      velocity: floats(at + 16, 3),
      orientation: floats(at + 28, 4),
      joints: floats(at + 44, 3 * JOINTS),
      confidence: new Uint8Array(buffer, at + 296, JOINTS),
      jointStates: new Uint8Array(buffer, at + 317, JOINTS),
      rotations: new Int16Array(buffer, at + 340, 64),
    });
  }
  const [fx, fy, cx, cy] = floats(48, 4);
  return {
    camera,
    sequence: long(8),
    captureNs: long(16),
    poseNs: long(24),
    publishNs: long(32),
    width: u32(40),
    height: u32(44),
    intrinsics: { fx, fy, cx, cy },
    times: { letterbox: u32(64), stage1: u32(68), association: u32(72), stage2: u32(76), fit: u32(80) },
    ended: (u32(84) & 1) !== 0,
    isFile: (u32(84) & 2) !== 0,
    world: { known: u32(92) !== 0, rotation: floats(96, 4), translation: floats(112, 3) },
    bodies,
  };
}
