"""Read edgecap's bodies from shared memory, in pure Python:

    import edgecap
    for frame in edgecap.bodies("camera0"):
        for body in frame.people():
            print(body.id, list(body.position), body.joint("r_wrist"), body.angle("r_elbow_flexion"))

The loop waits for a run that is not there yet, says on the logger `edgecap` when it goes and when it comes back, and
ends where a file does.  Where frames may fail to come, take them one by one:

    stream = edgecap.bodies("camera0")
    frame = stream.next(timeout_s=0.1)      # the oldest frame not yet read, or None
    frame = stream.newest(timeout_s=0.1)    # the newest one; older ones are left out
    stream.publishers()                     # 0 within a second of the publisher's death, 1 once it is back

What happens, rather than where everybody is, comes as a stream of its own (`docs/events.md`):

    for frame in edgecap.events("camera0"):
        for event in frame.events():
            print(event.event, event.person, event.zone)

Whether nobody is there or the camera is unplugged, `edgecap.health("camera0")` tells, once a second and at every
change:

    health = edgecap.health("camera0").newest()
    print(health.state if health else "nobody tells")

`frame.in_world(body)` gives a body in the floor-aligned world (y up, floor at y = 0) once a floor is known, else None.
With NumPy, `body.array("joints3d")` and `frame.array("joints3d")` are views of the message, not copies; NumPy is needed
for nothing else.

Camera frame: x right, y down, z forward, metres; pixels of the original picture; quaternions xyzw; times
CLOCK_MONOTONIC nanoseconds.  All errors are `EdgecapError` and say what to do.
"""

from .errors import AccessError, EdgecapError, NoFrame, UnknownName, VersionError
from .event import EVENTS, HANDS, MAX_EVENTS, Event, EventFrame
from .health_frame import HEALTH_STATES, PACES, HealthFrame
from .message import (
    APPEARANCE_BINS,
    FLAG_END_OF_STREAM,
    FLAG_FILE_TIME,
    JOINT_STATES,
    MAX_PEOPLE,
    STATES,
    Body,
    BodyFrame,
    Intrinsics,
    Observation,
    ObservationFrame,
    StageTimes,
)
from .names import (
    ANGLE_NAMES,
    BODY_JOINTS,
    COCO_JOINTS,
    COCO_KEYPOINTS,
    DOF,
    EVIDENCE_JOINTS,
    HUMANOID_BONES,
    HUMANOID_PARENTS,
    JOINT_NAMES,
    KINECT_JOINTS,
    KINECT_NAMES,
    PARENTS,
)
from .place import cameras, reading_dirs, runtime_dir
from .stream import Stream, bodies, events, health, observations
from .world import WORLD_STATES, World, WorldBody

__version__ = "0.1.0"

__all__ = [
    "ANGLE_NAMES",
    "APPEARANCE_BINS",
    "BODY_JOINTS",
    "COCO_JOINTS",
    "COCO_KEYPOINTS",
    "DOF",
    "EVENTS",
    "EVIDENCE_JOINTS",
    "FLAG_END_OF_STREAM",
    "FLAG_FILE_TIME",
    "HANDS",
    "HEALTH_STATES",
    "HUMANOID_BONES",
    "HUMANOID_PARENTS",
    "JOINT_NAMES",
    "JOINT_STATES",
    "KINECT_JOINTS",
    "KINECT_NAMES",
    "MAX_EVENTS",
    "MAX_PEOPLE",
    "PACES",
    "PARENTS",
    "STATES",
    "WORLD_STATES",
    "AccessError",
    "Body",
    "BodyFrame",
    "EdgecapError",
    "Event",
    "EventFrame",
    "HealthFrame",
    "Intrinsics",
    "NoFrame",
    "Observation",
    "ObservationFrame",
    "StageTimes",
    "Stream",
    "UnknownName",
    "VersionError",
    "World",
    "WorldBody",
    "bodies",
    "cameras",
    "events",
    "health",
    "observations",
    "reading_dirs",
    "runtime_dir",
]
