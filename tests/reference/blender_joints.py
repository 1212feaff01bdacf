"""Where Blender puts the joints of a file that it imports: `blender --background --python blender_joints.py -- FILE FPS FRAME...`

Importing glTF needs NumPy (`NO NUMPY` where there is none).  Prints one line `JOINTS {"FRAME": {"BONE": [x, y, z], ...}, ...}`, metres, in the file's axes (y up).  A bone that carries none
also has its end, as `BONE end`.  Frames count from 0."""

import builtins
import json
import sys

import bpy

try:
    import numpy

    # The importer of glTF of Blender 3.4 takes a name that NumPy no longer has.
    numpy.bool = bool
except ImportError:
    print("NO NUMPY")
# The importer of BVH of Blender 3.4 opens files in a mode that Python 3.11 no longer has.
opened = builtins.open
builtins.open = lambda name, mode="r", *more, **named: opened(name, mode.replace("U", ""), *more, **named)

path, fps, *frames = sys.argv[sys.argv.index("--") + 1 :]
bpy.ops.wm.read_factory_settings(use_empty=True)
scene = bpy.context.scene
if path.endswith(".bvh"):
    # As docs/export.md says; the scene keeps time of its own otherwise.
    bpy.ops.import_anim.bvh(
        filepath=path, global_scale=0.01, frame_start=1, update_scene_fps=True, update_scene_duration=True
    )
    first = 1
    assert abs(scene.render.fps / scene.render.fps_base - float(fps)) < 0.01, scene.render.fps
else:
    scene.render.fps = int(fps)
    bpy.ops.import_scene.gltf(filepath=path)
    first = 0


def upright(p):
    """Blender's z is up."""
    return [p.x, p.z, -p.y]


found = {}
for frame in frames:
    scene.frame_set(first + int(frame))
    places = found[frame] = {}
    for armature in (o for o in scene.objects if o.type == "ARMATURE"):
        for bone in armature.pose.bones:
            places[bone.name] = upright(armature.matrix_world @ bone.head)
            if not bone.children:
                places[f"{bone.name} end"] = upright(armature.matrix_world @ bone.tail)
print("JOINTS", json.dumps(found))
