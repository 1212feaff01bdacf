// What is shown in three dimensions. Everybody stands in the camera's own axes, in a group that turns these into the floor's.

import * as T from './three.min.js';
import { HEAD, HEAD_TOP, JOINTS, PARENTS, PELVIS } from './decode.js';
import { Orbit } from './orbit.js';

const MOST_PEOPLE = 32;
const TRAIL_NS = 10e9;
const TRAIL_POINTS = 8192;
const FRUSTUM_DEPTH = 0.7;
/** From the top of a head to the middle of its name, metres. */
const LABEL_ABOVE = 0.2;
const GREY = new T.Color(0x565d66);

export class Space {
  constructor(canvas) {
    this.renderer = new T.WebGLRenderer({ canvas, antialias: true });
    this.scene = new T.Scene();
    this.scene.background = new T.Color(0x14171c);
    this.eye = new T.PerspectiveCamera(50, 1, 0.05, 200);
    this.orbit = new Orbit(this.eye, canvas, () => { this.stale = true; });
    // Graphics memory that was taken away is given back empty.
    canvas.addEventListener('webglcontextrestored', () => { this.stale = true; });
    this.scene.add(new T.AmbientLight(0xffffff, 1.4));
    const sun = new T.DirectionalLight(0xffffff, 2.2);
    sun.position.set(2, 5, 3);
    this.scene.add(sun);
    this.floor = new T.GridHelper(20, 20, 0x4a5563, 0x2c333d);
    this.scene.add(this.floor);
    this.axes = new T.Group();
    this.scene.add(this.axes);
    const material = new T.MeshLambertMaterial();
    this.joints = instances(new T.SphereGeometry(1, 10, 8), material, MOST_PEOPLE * JOINTS);
    this.bones = instances(new T.CylinderGeometry(1, 1, 1, 8, 1), material, MOST_PEOPLE * JOINTS);
    this.axes.add(this.joints, this.bones);
    this.labels = Array.from({ length: MOST_PEOPLE }, () => new Label(this.axes));
    this.frustum = lines(16, 0xd9a441);
    this.axes.add(this.frustum);
    this.trails = lines(TRAIL_POINTS, 0xffffff, true);
    this.scene.add(this.trails);
    this.shown = null;
    this.stale = true;
    this.work = [];
  }

  /** Shows one of `frames`, the newest last; those before it give the trails. */
  show(frame, frames, index) {
    const [wasKnown, before] = [this.shown?.world.known ?? frame.world.known, this.floor.position.y];
    this.shown = frame;
    place(this.axes, frame.world);
    this.floor.position.y = frame.world.known ? 0 : this.lowest(frame);
    if (this.looked && wasKnown !== frame.world.known) this.orbit.lift(this.floor.position.y - before);
    let instance = 0;
    frame.bodies.slice(0, MOST_PEOPLE).forEach((body, n) => {
      instance = this.showBody(body, instance);
      this.labels[n].show(body);
    });
    this.labels.slice(frame.bodies.length).forEach((label) => label.hide());
    for (const mesh of [this.joints, this.bones]) {
      mesh.count = instance;
      mesh.instanceMatrix.needsUpdate = true;
      if (mesh.instanceColor) mesh.instanceColor.needsUpdate = true;
    }
    this.showFrustum(frame);
    this.showTrails(frame, frames, index);
    this.lookAtFirst(frame);
    this.stale = true;
  }

  /** Turns to the people of the first frame that has any. */
  lookAtFirst(frame) {
    if (this.looked || frame.bodies.length === 0) return;
    this.looked = true;
    const middle = new T.Vector3();
    for (const body of frame.bodies) middle.add(this.onFloor(frame, body));
    this.orbit.target.copy(middle.divideScalar(frame.bodies.length));
    this.orbit.target.y = this.floor.position.y + 0.9;
    this.orbit.distance = Math.max(5, 1.3 * Math.abs(middle.z));
    this.orbit.apply();
  }

  showBody(body, first) {
    const [matrix, a, b] = [new T.Matrix4(), new T.Vector3(), new T.Vector3()];
    const colour = colourOf(body.id);
    const tint = new T.Color();
    for (let j = 0; j < JOINTS; j++) {
      const index = first + j;
      point(body, j, a);
      point(body, PARENTS[j], b);
      const radius = j === HEAD ? 0.095 : j === HEAD_TOP ? 0.02 : 0.032;
      matrix.makeScale(radius, radius, radius).setPosition(a);
      this.joints.setMatrixAt(index, matrix);
      this.bones.setMatrixAt(index, j === PELVIS ? matrix : between(b, a, 0.022, matrix));
      tint.copy(GREY).lerp(colour, body.confidence[j] / 255);
      this.joints.setColorAt(index, tint);
      this.bones.setColorAt(index, tint);
    }
    return first + JOINTS;
  }

  showFrustum({ width, height, intrinsics: { fx, fy, cx, cy } }) {
    const corner = (u, v) => [((u - cx) / fx) * FRUSTUM_DEPTH, ((v - cy) / fy) * FRUSTUM_DEPTH, FRUSTUM_DEPTH];
    const corners = fx > 0 && fy > 0
      ? [corner(-0.5, -0.5), corner(width - 0.5, -0.5), corner(width - 0.5, height - 0.5), corner(-0.5, height - 0.5)]
      : [];
    const points = corners.flatMap((c, i) => [[0, 0, 0], c, c, corners[(i + 1) % 4]]);
    setLine(this.frustum, points.flat());
  }

  showTrails(frame, frames, index) {
    const positions = this.trails.geometry.attributes.position.array;
    const colours = this.trails.geometry.attributes.color.array;
    const last = new Map(frame.bodies.map((body) => [body.id, this.onFloor(frame, body)]));
    let n = 0;
    for (let k = index - 1; k >= 0 && frame.publishNs - frames[k].publishNs < TRAIL_NS; k--) {
      // Before an end, and where numbers go back, others have the same ids.
      if (frames[k + 1].begins || frames[k].sequence > frames[k + 1].sequence) break;
      const fresh = 1 - (frame.publishNs - frames[k].publishNs) / TRAIL_NS;
      for (const body of frames[k].bodies) {
        const from = last.get(body.id);
        if (!from || n + 2 > TRAIL_POINTS) continue;
        const to = this.onFloor(frames[k], body);
        // A point every five centimetres: standing still leaves no heap.
        if (from.distanceToSquared(to) < 0.0025) continue;
        const colour = colourOf(body.id);
        for (const p of [from, to]) {
          positions.set([p.x, p.y, p.z], 3 * n);
          colours.set([colour.r * fresh, colour.g * fresh, colour.b * fresh], 3 * n);
          n++;
        }
        last.set(body.id, to);
      }
    }
    this.trails.geometry.setDrawRange(0, n);
    this.trails.geometry.attributes.position.needsUpdate = true;
    this.trails.geometry.attributes.color.needsUpdate = true;
  }

  onFloor(frame, body) {
    const p = point(body, PELVIS, new T.Vector3()).applyMatrix4(matrixOf(frame.world));
    p.y = this.floor.position.y + 0.01;
    return p;
  }

  /** Height of the lowest joint: where the floor is drawn while none is known. */
  lowest(frame) {
    let low = Infinity;
    for (const body of frame.bodies) for (let j = 0; j < JOINTS; j++) low = Math.min(low, -body.joints[3 * j + 1]);
    return Number.isFinite(low) ? low - 0.03 : this.floor.position.y;
  }

  clear() {
    this.shown = null;
    this.looked = false;
    this.joints.count = 0;
    this.bones.count = 0;
    this.labels.forEach((label) => label.hide());
    setLine(this.frustum, []);
    this.trails.geometry.setDrawRange(0, 0);
    this.stale = true;
  }

  /** Draws, where something has changed; `since` is when the work on this picture began. */
  draw(since) {
    const { clientWidth: width, clientHeight: height } = this.renderer.domElement;
    const size = `${width}x${height}x${window.devicePixelRatio}`;
    if (size !== this.size) {
      this.size = size;
      this.renderer.setPixelRatio(window.devicePixelRatio);
      this.renderer.setSize(width, height, false);
      this.eye.aspect = width / Math.max(1, height);
      this.eye.updateProjectionMatrix();
      this.stale = true;
    }
    if (!this.stale) return;
    this.stale = false;
    this.renderer.render(this.scene, this.eye);
    this.work.push(performance.now() - since);
    if (this.work.length > 240) this.work.shift();
  }

  /** What is drawn now, read back from the drawn things: metres in the floor's axes, or the camera's set upright. */
  read() {
    this.scene.updateMatrixWorld(true);
    const [matrix, p] = [new T.Matrix4(), new T.Vector3()];
    const drawn = (mesh, index) => {
      mesh.getMatrixAt(index, matrix);
      return p.setFromMatrixPosition(matrix).applyMatrix4(mesh.matrixWorld).toArray();
    };
    const bodies = this.shown?.bodies.slice(0, this.joints.count / JOINTS) ?? [];
    const people = bodies.map((body, n) => ({
      id: body.id,
      label: this.labels[n].text,
      labelAt: this.labels[n].sprite.getWorldPosition(p).toArray(),
      joints: Array.from({ length: JOINTS }, (_, j) => drawn(this.joints, n * JOINTS + j)),
    }));
    const frustum = this.frustum.geometry;
    const corners = Array.from({ length: frustum.drawRange.count / 4 }, (_, i) =>
      p.fromBufferAttribute(frustum.attributes.position, 4 * i + 1).applyMatrix4(this.axes.matrixWorld).toArray());
    const work = [...this.work].sort((a, b) => a - b);
    return {
      camera: this.shown?.camera ?? null,
      sequence: this.shown?.sequence ?? null,
      people,
      frustum: corners,
      trailPoints: this.trails.geometry.drawRange.count,
      floor: this.floor.position.y,
      looksAt: this.orbit.target.toArray(),
      turned: this.orbit.azimuth,
      drawCalls: this.renderer.info.render.calls,
      workMs: work[work.length >> 1] ?? null,
    };
  }
}

/** The same colour for the same person, as different as can be for neighbours. */
export function colourOf(id) {
  return new T.Color().setHSL((id * 0.618034) % 1, 0.75, 0.58);
}

class Label {
  constructor(parent) {
    this.canvas = Object.assign(document.createElement('canvas'), { width: 256, height: 64 });
    this.texture = new T.CanvasTexture(this.canvas);
    this.sprite = new T.Sprite(new T.SpriteMaterial({ map: this.texture, depthTest: false }));
    this.sprite.scale.set(0.56, 0.14, 1);
    parent.add(this.sprite);
    this.hide();
  }

  show(body) {
    const text = `#${body.id}  ${Math.round(100 * body.score)} %`;
    this.sprite.visible = true;
    // Above the head as it is drawn: which way that is in the camera's axes, the group that turns them says.
    const turn = this.sprite.parent.quaternion.clone().invert();
    const above = UP.clone().multiplyScalar(LABEL_ABOVE).applyQuaternion(turn);
    point(body, HEAD_TOP, this.sprite.position).add(above);
    if (text === this.text) return;
    this.text = text;
    const pen = this.canvas.getContext('2d');
    pen.clearRect(0, 0, 256, 64);
    pen.font = '600 40px system-ui, sans-serif';
    pen.textAlign = 'center';
    pen.textBaseline = 'middle';
    pen.lineWidth = 6;
    pen.strokeStyle = '#14171c';
    pen.strokeText(text, 128, 32);
    pen.fillStyle = `#${colourOf(body.id).getHexString()}`;
    pen.fillText(text, 128, 32);
    this.texture.needsUpdate = true;
  }

  hide() {
    this.sprite.visible = false;
    this.text = null;
  }
}

function instances(geometry, material, most) {
  const mesh = new T.InstancedMesh(geometry, material, most);
  mesh.instanceMatrix.setUsage(T.DynamicDrawUsage);
  mesh.frustumCulled = false;
  mesh.count = 0;
  return mesh;
}

function lines(points, colour, vertexColors = false) {
  const geometry = new T.BufferGeometry();
  for (const name of vertexColors ? ['position', 'color'] : ['position']) {
    geometry.setAttribute(name, new T.BufferAttribute(new Float32Array(3 * points), 3).setUsage(T.DynamicDrawUsage));
  }
  geometry.setDrawRange(0, 0);
  const drawn = new T.LineSegments(geometry, new T.LineBasicMaterial({ color: colour, vertexColors }));
  drawn.frustumCulled = false;
  return drawn;
}

function setLine(line, numbers) {
  line.geometry.attributes.position.array.set(numbers);
  line.geometry.attributes.position.needsUpdate = true;
  line.geometry.setDrawRange(0, numbers.length / 3);
}

function point(body, joint, out) {
  return out.fromArray(body.joints, 3 * joint);
}

const UP = new T.Vector3(0, 1, 0);

/** A unit cylinder stretched from one point to another. */
function between(from, to, radius, out) {
  const along = to.clone().sub(from);
  const length = Math.max(along.length(), 1e-6);
  const turn = new T.Quaternion().setFromUnitVectors(UP, along.divideScalar(length));
  return out.compose(from.clone().add(to).multiplyScalar(0.5), turn, new T.Vector3(radius, length, radius));
}

/** A place in the world, metres; y points up. */
export function inWorld(world, place) {
  return new T.Vector3().fromArray(place).applyMatrix4(matrixOf(world));
}

/** From camera axes to the floor's. Where no floor is known the camera's axes are set upright. */
function matrixOf(world) {
  const turn = world.known ? new T.Quaternion().fromArray(world.rotation) : new T.Quaternion(1, 0, 0, 0);
  const origin = world.known ? new T.Vector3().fromArray(world.translation) : new T.Vector3();
  return new T.Matrix4().compose(origin, turn, new T.Vector3(1, 1, 1));
}

function place(group, world) {
  matrixOf(world).decompose(group.position, group.quaternion, group.scale);
}
