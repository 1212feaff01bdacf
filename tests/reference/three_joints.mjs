// What three.js and Khronos' validator make of a glTF file:
// `EDGECAP_NODE_MODULES=DIR node three_joints.mjs FILE SECONDS...`, with `three` and `gltf-validator` in DIR.
//
// Prints `ISSUES {"numErrors": 0, ...}` and `JOINTS {"SECONDS": {"BONE": [x, y, z], ...}, ...}`, metres, in the file's
// axes (y up).

import { readFileSync } from 'node:fs';
import { createRequire } from 'node:module';
import { join, resolve } from 'node:path';
import { pathToFileURL } from 'node:url';

// Browsers have it, and the loader asks for it.
globalThis.self = globalThis;

const modules = resolve(process.env.EDGECAP_NODE_MODULES);
const file = (...parts) => pathToFileURL(join(modules, ...parts)).href;
const { AnimationMixer, LoopOnce, Vector3 } = await import(file('three', 'build', 'three.module.js'));
const { GLTFLoader } = await import(file('three', 'examples', 'jsm', 'loaders', 'GLTFLoader.js'));
const validator = createRequire(import.meta.url)(join(modules, 'gltf-validator'));

const [path, ...moments] = process.argv.slice(2);
const bytes = new Uint8Array(readFileSync(path));
const { issues } = await validator.validateBytes(bytes);
console.log('ISSUES', JSON.stringify(issues));

const { scene, animations } = await new GLTFLoader().parseAsync(bytes.buffer, '');
const mixer = new AnimationMixer(scene);
const actions = animations.map((clip) => mixer.clipAction(clip));
const found = {};
for (const moment of moments) {
  // Once: what the last keys say stays.
  for (const action of actions) {
    action.reset().setLoop(LoopOnce).play();
    action.clampWhenFinished = true;
  }
  mixer.setTime(Number(moment));
  scene.updateMatrixWorld(true);
  const places = (found[moment] = {});
  scene.traverse((node) => {
    if (node.isSkinnedMesh) {
      // Of the skin as it is drawn, the lowest and the highest point.
      const [at, heights] = [new Vector3(), []];
      for (let i = 0; i < node.geometry.attributes.position.count; i++) {
        node.getVertexPosition(i, at).applyMatrix4(node.matrixWorld);
        heights.push(at.y);
      }
      places[node.name] = [Math.min(...heights), Math.max(...heights), heights.length];
    }
    if (node.isBone) places[node.name] = node.getWorldPosition(new Vector3()).toArray();
  });
}
console.log('JOINTS', JSON.stringify(found));
