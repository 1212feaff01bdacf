"""The reader in Python of the conformance test: every field of every frame."""

import struct
import sys

import edgecap


def flat(values):
    for v in values if hasattr(values, "__len__") else [values]:
        if hasattr(v, "__len__"):
            yield from flat(v)
        else:
            yield v


def line(label, *values):
    print(label, *values)


def bits(label, *fields):
    line(label, *(f"{struct.unpack('=I', struct.pack('=f', v))[0]:08x}" for field in fields for v in flat(field)))


def body(frame, b):
    line("id", b.id)
    line("state", b.state)
    bits("score", b.score)
    bits("position", b.position)
    bits("orientation", b.orientation)
    bits("velocity", b.velocity)
    bits("angles", [b.angle(name) for name in edgecap.ANGLE_NAMES])
    bits("joints3d", [b.joint(name) for name in edgecap.JOINT_NAMES])
    bits("joints2d", [b.joint2d(name) for name in edgecap.JOINT_NAMES])
    bits("confidence", [b.joint_confidence(name) for name in edgecap.JOINT_NAMES])
    bits("height", b.height)
    bits("bone_lengths", [b.bone_length(name) for name in edgecap.JOINT_NAMES])
    bits("bone_rotations", [b.bone_rotation(name) for name in edgecap.HUMANOID_BONES])
    line("joint_states", *(b.joint_state(name) for name in edgecap.JOINT_NAMES))
    there = frame.in_world(b)
    if there is not None:
        line("~there", *there.position, *there.orientation, *there.velocity, *flat(there.joints3d))


def stages(t):
    line("stages", t.preprocess_us, t.stage1_us, t.association_us, t.stage2_us)


streams = [of(sys.argv[1]) for of in (edgecap.bodies, edgecap.observations, edgecap.events, edgecap.health)]
print("ready", flush=True)
line("joints", *edgecap.JOINT_NAMES)
line("parents", *edgecap.PARENTS)
line("angles", *edgecap.ANGLE_NAMES)
line("bones", *edgecap.HUMANOID_BONES)
line("carriers", *edgecap.HUMANOID_PARENTS)
for layout, names, joints in (
    ("coco", edgecap.COCO_KEYPOINTS, edgecap.COCO_JOINTS),
    ("kinect", edgecap.KINECT_NAMES, edgecap.KINECT_JOINTS),
):
    line(layout, *(f"{name}={-1 if joint is None else joint}" for name, joint in zip(names, joints)))
line("events", *edgecap.EVENTS)
for f in streams[0]:
    line("sequence", f.sequence)
    line("times", f.capture_ns, f.pose_ns, f.publish_ns)
    line("size", f.width, f.height)
    bits("intrinsics", f.intrinsics.fx, f.intrinsics.fy, f.intrinsics.cx, f.intrinsics.cy)
    stages(f.stage_times)
    line("fit", f.fit_us)
    line("flags", f.flags)
    line("count", f.count, f.frame_total)
    bits("world", f.world.rotation, f.world.translation)
    line("floor", f.world.state)
    for b in f.people():
        body(f, b)
for f in streams[1]:
    line("seen", f.sequence)
    line("times", f.capture_ns, f.publish_ns)
    line("size", f.width, f.height)
    bits("intrinsics", f.intrinsics.fx, f.intrinsics.fy, f.intrinsics.cx, f.intrinsics.cy)
    stages(f.stage_times)
    line("flags", f.flags)
    line("count", f.count, f.frame_total, f.without_neck)
    for p in f.people():
        bits("score", p.score)
        bits("joints2d", p.joints2d)
        bits("joints3d", p.joints3d)
        bits("hue", p.hue)
        bits("saturation", p.saturation)
for f in streams[2]:
    line("happened", f.sequence)
    line("times", f.time_ns, f.publish_ns)
    line("first", f.first)
    line("flags", f.flags)
    line("count", f.count, f.present, f.main_person or 0)
    for e in f.events():
        line("event", e.event)
        line("person", e.person or 0)
        bits("seconds", e.seconds)
        line("hand", e.hand or "none")
        line("zone", *([e.zone] if e.zone else []))
for f in streams[3]:
    line("health", f.state)
    line("pace", f.pace)
    line("times", f.publish_ns, f.started_ns, f.since_ns, f.capture_ns)
    line("counts", f.sequence, f.observed, f.left_out)
    line("flags", f.flags)
    bits("rates", f.source_hz, f.observed_hz, f.look_hz)
    line("latency", f.latency_us)
    line("people", f.people)
    line("input", f.input_width, f.input_height)
    line("again", f.reconnects, f.restarts)
    line("cameras", f.cameras, f.cameras_live)
