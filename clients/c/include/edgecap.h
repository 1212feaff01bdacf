/* Read edgecap's bodies, events, observations and health from shared memory in C99 or C++11;
 * clients/c/examples/bodies.c is a whole program, edgecap.hpp wraps this for C++.
 *
 * Camera frame: x right, y down, z forward, metres; pixels are those of the original picture, pixel centres on integers;
 * quaternions are xyzw; times are CLOCK_MONOTONIC nanoseconds.  The structures mirror clients/rust/src/message, whose
 * layout a test holds against this file.
 *
 * A reader belongs to the thread that opened it; calls from another one fail.  A program may have several readers, and
 * any number may read one camera.  Failures are told by edgecap_error() in one line.
 *
 * While a reader is opened, and whenever a run comes back, the whole process's umask is 0177 for a moment: open it before
 * other threads make files or start programs.  A reader does not outlive fork() or daemon(): open it in the process that
 * reads.  Programs that this one starts keep some 15 of a reader's descriptors open, and with them the memory of runs that
 * have ended; one that changes its user may still write there.  Between fork() and exec() close them:
 * close_range(3, ~0U, CLOSE_RANGE_CLOEXEC), from Linux 5.11 on. */
#ifndef EDGECAP_H
#define EDGECAP_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define EDGECAP_MAX_PEOPLE 32
#define EDGECAP_MAX_EVENTS 32
#define EDGECAP_ZONE_NAME 64
#define EDGECAP_EVIDENCE_JOINTS 14
#define EDGECAP_APPEARANCE_BINS 30
#define EDGECAP_BODY_JOINTS 21
#define EDGECAP_DOF 29
#define EDGECAP_BONES 16
#define EDGECAP_COCO_KEYPOINTS 17
#define EDGECAP_KINECT_JOINTS 32

/* Indices of joints; the first EDGECAP_EVIDENCE_JOINTS are those of observations. */
enum edgecap_joint {
    EDGECAP_HEAD_TOP,
    EDGECAP_NECK,
    EDGECAP_R_SHOULDER,
    EDGECAP_R_ELBOW,
    EDGECAP_R_WRIST,
    EDGECAP_L_SHOULDER,
    EDGECAP_L_ELBOW,
    EDGECAP_L_WRIST,
    EDGECAP_R_HIP,
    EDGECAP_R_KNEE,
    EDGECAP_R_ANKLE,
    EDGECAP_L_HIP,
    EDGECAP_L_KNEE,
    EDGECAP_L_ANKLE,
    EDGECAP_PELVIS,
    EDGECAP_SPINE,
    EDGECAP_HEAD,
    EDGECAP_R_HAND,
    EDGECAP_L_HAND,
    EDGECAP_R_FOOT_TIP,
    EDGECAP_L_FOOT_TIP
};

/* Indices of edgecap_body.angles: the pelvis' place in metres, then radians. */
enum edgecap_angle {
    EDGECAP_ANGLE_PELVIS_TX,
    EDGECAP_ANGLE_PELVIS_TY,
    EDGECAP_ANGLE_PELVIS_TZ,
    EDGECAP_ANGLE_PELVIS_RX,
    EDGECAP_ANGLE_PELVIS_RY,
    EDGECAP_ANGLE_PELVIS_RZ,
    EDGECAP_ANGLE_SPINE_FLEXION,
    EDGECAP_ANGLE_SPINE_LATERAL,
    EDGECAP_ANGLE_SPINE_TWIST,
    EDGECAP_ANGLE_NECK_FLEXION,
    EDGECAP_ANGLE_NECK_YAW,
    EDGECAP_ANGLE_R_SHOULDER_FLEXION,
    EDGECAP_ANGLE_R_SHOULDER_ABDUCTION,
    EDGECAP_ANGLE_R_SHOULDER_ROTATION,
    EDGECAP_ANGLE_R_ELBOW_FLEXION,
    EDGECAP_ANGLE_L_SHOULDER_FLEXION,
    EDGECAP_ANGLE_L_SHOULDER_ABDUCTION,
    EDGECAP_ANGLE_L_SHOULDER_ROTATION,
    EDGECAP_ANGLE_L_ELBOW_FLEXION,
    EDGECAP_ANGLE_R_HIP_FLEXION,
    EDGECAP_ANGLE_R_HIP_ABDUCTION,
    EDGECAP_ANGLE_R_HIP_ROTATION,
    EDGECAP_ANGLE_R_KNEE_FLEXION,
    EDGECAP_ANGLE_R_ANKLE_FLEXION,
    EDGECAP_ANGLE_L_HIP_FLEXION,
    EDGECAP_ANGLE_L_HIP_ABDUCTION,
    EDGECAP_ANGLE_L_HIP_ROTATION,
    EDGECAP_ANGLE_L_KNEE_FLEXION,
    EDGECAP_ANGLE_L_ANKLE_FLEXION
};

/* Indices of edgecap_body.bone_rotations. */
enum edgecap_bone {
    EDGECAP_BONE_HIPS,
    EDGECAP_BONE_SPINE,
    EDGECAP_BONE_NECK,
    EDGECAP_BONE_HEAD,
    EDGECAP_BONE_RIGHT_UPPER_ARM,
    EDGECAP_BONE_RIGHT_LOWER_ARM,
    EDGECAP_BONE_RIGHT_HAND,
    EDGECAP_BONE_LEFT_UPPER_ARM,
    EDGECAP_BONE_LEFT_LOWER_ARM,
    EDGECAP_BONE_LEFT_HAND,
    EDGECAP_BONE_RIGHT_UPPER_LEG,
    EDGECAP_BONE_RIGHT_LOWER_LEG,
    EDGECAP_BONE_RIGHT_FOOT,
    EDGECAP_BONE_LEFT_UPPER_LEG,
    EDGECAP_BONE_LEFT_LOWER_LEG,
    EDGECAP_BONE_LEFT_FOOT
};

/* Bits of the flags of every frame. */
enum edgecap_flag {
    EDGECAP_END_OF_STREAM = 1, /* the input has ended, this frame holds nobody new */
    EDGECAP_FILE_TIME = 2,     /* times are a file's presentation times, not CLOCK_MONOTONIC */
    EDGECAP_END_OF_FILE = 3    /* both: a file has ended, and nothing follows; a camera's run may come back */
};

/* edgecap_body.state */
enum edgecap_body_state {
    EDGECAP_BODY_TENTATIVE = 0, /* never published */
    EDGECAP_BODY_TRACKED = 1,   /* seen in this frame */
    EDGECAP_BODY_PREDICTED = 2  /* not seen in this frame, extrapolated */
};

/* edgecap_body.joint_states */
enum edgecap_joint_state {
    EDGECAP_JOINT_PREDICTED = 0, /* by motion alone: the person was not seen in this frame */
    EDGECAP_JOINT_OCCLUDED = 1,  /* filled in from the person's other joints */
    EDGECAP_JOINT_OBSERVED = 2   /* seen in this frame */
};

/* edgecap_world.state */
enum edgecap_world_state {
    EDGECAP_WORLD_NONE = 0,      /* no floor is known: there is no world */
    EDGECAP_WORLD_ESTIMATED = 1, /* the floor was found from standing feet */
    EDGECAP_WORLD_GIVEN = 2      /* the floor is given by the settings */
};

/* edgecap_event.kind; seconds are those of edgecap_event.seconds */
enum edgecap_event_kind {
    EDGECAP_EVENT_ENTERED = 0,      /* somebody is there for the first time */
    EDGECAP_EVENT_LEFT = 1,         /* somebody is away; seconds they were there */
    EDGECAP_EVENT_CAME_BACK = 2,    /* somebody who had left is there again; seconds they were away */
    EDGECAP_EVENT_ZONE_ENTERED = 3, /* somebody has stepped into a zone of the floor */
    EDGECAP_EVENT_ZONE_LEFT = 4,    /* somebody has stepped out of it, or left; seconds they were in it */
    EDGECAP_EVENT_DWELT = 5,        /* somebody has been in a zone for its dwell; seconds by now */
    EDGECAP_EVENT_HAND_RAISED = 6,  /* a hand is above the head */
    EDGECAP_EVENT_HAND_LOWERED = 7, /* it is below the shoulder again */
    EDGECAP_EVENT_WAVED = 8,        /* a hand has gone to and fro */
    EDGECAP_EVENT_MAIN_PERSON = 9   /* another person is the nearest to the camera */
};

/* edgecap_event.hand: the person's own */
enum edgecap_hand { EDGECAP_HAND_NONE = 0, EDGECAP_HAND_LEFT = 1, EDGECAP_HAND_RIGHT = 2 };

/* edgecap_health_frame.state: what has become of the pictures */
enum edgecap_health_state {
    EDGECAP_HEALTH_STARTING = 0, /* none has come yet */
    EDGECAP_HEALTH_LIVE = 1,     /* they come and are gone through */
    EDGECAP_HEALTH_IDLE = 2,     /* they come; nobody is in view, so that only a few are glanced at */
    EDGECAP_HEALTH_STALLED = 3,  /* none has come for a second, or 2.5 intervals, or none that can be decoded */
    EDGECAP_HEALTH_AWAY = 4,     /* the camera is not there and is looked for, or its pictures do not fit its lens */
    EDGECAP_HEALTH_ENDED = 5     /* the input has ended, or the process that tells has: nothing follows from it */
};

/* edgecap_health_frame.pace: whether the machine is fast enough */
enum edgecap_health_pace {
    EDGECAP_PACE_UNKNOWN = 0,  /* not told: of files, rooms, an empty place, and before a second has been measured */
    EDGECAP_PACE_KEEPS_UP = 1, /* of the pictures that come and are wanted nine in ten at least are gone through */
    EDGECAP_PACE_BEHIND = 2    /* fewer are: the others are dropped */
};

/* Pinhole camera of the original picture, pixels. */
typedef struct edgecap_intrinsics {
    float fx, fy, cx, cy;
} edgecap_intrinsics;

/* Time spent per stage of `infer`, microseconds. */
typedef struct edgecap_stage_times {
    uint32_t preprocess_us, stage1_us, association_us, stage2_us;
} edgecap_stage_times;

/* One person with an identity. */
typedef struct edgecap_body {
    uint32_t id;          /* from 1, never given twice while `run` runs, or `fit` alone */
    uint32_t state;       /* enum edgecap_body_state */
    float score;          /* overall confidence, 0 to 1 */
    float position[3];    /* pelvis in camera space, metres */
    float orientation[4]; /* of the pelvis, from rest axes (x to the person's left, y up, z front) to camera axes, xyzw */
    float velocity[3];    /* of the pelvis, metres per second */
    float angles[EDGECAP_DOF]; /* root translation (m) and rotation vector (rad), 23 joint angles (rad); edgecap_angle_name */
    float joints3d[EDGECAP_BODY_JOINTS][3];    /* camera space, metres */
    float joints2d[EDGECAP_BODY_JOINTS][2];    /* the same in the original picture, pixels; 0, 0 behind the camera */
    float confidence[EDGECAP_BODY_JOINTS];     /* probability that a joint is within 150 mm of the truth */
    float height;                              /* stature, metres */
    float bone_lengths[EDGECAP_BODY_JOINTS];   /* of the bone that ends in each joint, metres; 0 for the pelvis */
    float bone_rotations[EDGECAP_BONES][4];    /* local, xyzw, from a T-pose with axes x left, y up, z front; edgecap_bone_name */
    uint8_t joint_states[EDGECAP_BODY_JOINTS]; /* enum edgecap_joint_state */
    uint8_t reserved[3];                       /* zeros */
} edgecap_body;

/* The floor-aligned world: x to the camera's right along the floor, y up, z towards the viewer, metres, origin on the floor
 * below the camera.  world = rotation * camera + translation. */
typedef struct edgecap_world {
    float rotation[4]; /* xyzw */
    float translation[3];
    uint32_t state; /* enum edgecap_world_state */
} edgecap_world;

/* Everyone with an identity. */
typedef struct edgecap_body_frame {
    uint64_t sequence;   /* of the newest picture behind this frame, from 0; goes on where infer is started again */
    uint64_t capture_ns; /* when that picture was taken */
    uint64_t pose_ns;    /* the time the bodies are given for */
    uint64_t publish_ns; /* when this frame was published; minus capture_ns it is the latency */
    uint32_t width, height; /* of the original picture, pixels */
    edgecap_intrinsics intrinsics;
    edgecap_stage_times stage_times;
    uint32_t fit_us;      /* identity and fit, microseconds */
    uint32_t flags;       /* enum edgecap_flag */
    uint32_t count;       /* valid entries of bodies */
    uint32_t frame_total; /* frames of the input; 0 when not known */
    edgecap_world world;
    edgecap_body bodies[EDGECAP_MAX_PEOPLE]; /* by rising id */
} edgecap_body_frame;

/* A body in the floor-aligned world. */
typedef struct edgecap_world_body {
    float position[3];
    float orientation[4]; /* upright and facing the camera: identity */
    float velocity[3];
    float joints3d[EDGECAP_BODY_JOINTS][3];
} edgecap_world_body;

/* Something that has happened, once it was certain. */
typedef struct edgecap_event {
    uint32_t kind;   /* enum edgecap_event_kind */
    uint32_t person; /* id of the body; 0 where nobody is the main person any more */
    float seconds;   /* what the kind says of it, or 0 */
    uint32_t hand;   /* enum edgecap_hand */
    char zone[EDGECAP_ZONE_NAME]; /* the zone's name in UTF-8, ended by a zero; empty where it is no event of a zone */
} edgecap_event;

/* What was certain by one frame of bodies.  Where nothing happens no frame comes. */
typedef struct edgecap_event_frame {
    uint64_t sequence;    /* edgecap_body_frame.sequence of that frame */
    uint64_t time_ns;     /* its pose_ns */
    uint64_t publish_ns;  /* when this frame was published */
    uint64_t first;       /* events of this publisher before these: more than a reader has had, and it has lost some */
    uint32_t flags;       /* enum edgecap_flag */
    uint32_t count;       /* valid entries of events */
    uint32_t present;     /* people who are there now */
    uint32_t main_person; /* now; 0: nobody */
    edgecap_event events[EDGECAP_MAX_EVENTS]; /* in the order in which they were certain */
} edgecap_event_frame;

/* One person as seen in one picture, before the fit. */
typedef struct edgecap_observation {
    float score; /* probability that somebody is there, 0 to 1 */
    /* u, v in pixels of the original picture, and confidence: the probability of being within 0.2 of the torso's length of
       the truth; of confidence 0: not seen, u and v are where it is expected */
    float joints2d[EDGECAP_EVIDENCE_JOINTS][3];
    /* relative to the pelvis, camera axes, metres, of the person rescaled to 1.70 m; unseen joints are filled in */
    float joints3d[EDGECAP_BODY_JOINTS][3];
    float hue[EDGECAP_APPEARANCE_BINS];        /* of the torso, sums to 1; zeros where the torso was not seen */
    float saturation[EDGECAP_APPEARANCE_BINS]; /* likewise */
} edgecap_observation;

/* Everyone seen in one picture. */
typedef struct edgecap_observation_frame {
    uint64_t sequence;   /* counts the pictures from 0; gaps are dropped pictures */
    uint64_t capture_ns; /* when it was taken */
    uint64_t publish_ns; /* when this frame was published */
    uint32_t width, height; /* of the picture, pixels */
    edgecap_intrinsics intrinsics;
    edgecap_stage_times stage_times;
    uint32_t flags;        /* enum edgecap_flag */
    uint32_t without_neck; /* people left out because their neck was not found: whole arms or legs of nobody */
    uint32_t count;        /* valid entries of people */
    uint32_t frame_total;  /* pictures of the input; 0 when not known */
    edgecap_observation people[EDGECAP_MAX_PEOPLE]; /* by falling score */
} edgecap_observation_frame;

/* How a camera is doing, as the process that sees its pictures knows it; of a room of several cameras, as `fit` does.
 * Published at every change of the state and about once a second, also while the camera is away.  While somebody
 * publishes and none comes for several seconds, that process hangs. */
typedef struct edgecap_health_frame {
    uint64_t publish_ns;  /* when this frame was published; this and the next two are CLOCK_MONOTONIC of files, too */
    uint64_t started_ns;  /* when the process that tells began to: what is counted is counted from then on */
    uint64_t since_ns;    /* since when the state is what it is */
    uint64_t sequence;    /* of the newest picture, as observations (of a room, bodies) have it */
    uint64_t capture_ns;  /* when that was taken; 0 before the first */
    uint64_t observed;    /* pictures of which was published who is in them; of a room, instants */
    uint64_t left_out;    /* pictures that the camera took between those: dropped, or left out on purpose; of files 0 */
    uint32_t state;       /* enum edgecap_health_state */
    uint32_t flags;       /* enum edgecap_flag */
    float source_hz;      /* pictures a second that the camera takes; 0: not known */
    float observed_hz;    /* pictures a second of which is published who is in them */
    float look_hz;        /* pictures a second of those that the network looks at */
    uint32_t latency_us;  /* from capture to publication, of observations, of a room of bodies; median; 0: not known */
    uint32_t pace;        /* enum edgecap_health_pace */
    uint32_t people;      /* in the newest picture; 0 while none comes */
    uint32_t input_width, input_height; /* of the network's input for a whole picture, pixels; 0: not known */
    uint32_t reconnects;  /* how often the camera came back */
    uint32_t restarts;    /* how often `run` has started this process again */
    uint32_t cameras;     /* that this is about: 1, of a room all that belong to it */
    uint32_t cameras_live; /* those of them whose pictures come */
} edgecap_health_frame;

/* Readers of one camera's bodies, events, observations and health. */
typedef struct edgecap_bodies edgecap_bodies;
typedef struct edgecap_events edgecap_events;
typedef struct edgecap_observations edgecap_observations;
typedef struct edgecap_health edgecap_health;

/* Connects to the bodies of the run with this --name ("camera0" when it was given none), which need not run yet.
 * NULL when that fails. */
edgecap_bodies *edgecap_bodies_open(const char *camera);

/* The oldest frame not yet read, waiting up to timeout_ms for one: 1 and the frame; 0 when none came (it may come back a
 * little early: call again); -1 when it failed.  The frame lies in shared memory, is read-only, and is valid until the next call
 * with this reader.  A reader that is more than 16 frames behind loses the oldest.  One that comes while a run publishes
 * begins with the newest frame, or with the next where that was published more than two seconds ago and does not end the
 * run: whoever was in it may have left. */
int edgecap_bodies_next(edgecap_bodies *reader, uint32_t timeout_ms, const edgecap_body_frame **frame);

/* The newest frame; older unread ones are thrown away.  Otherwise as edgecap_bodies_next. */
int edgecap_bodies_newest(edgecap_bodies *reader, uint32_t timeout_ms, const edgecap_body_frame **frame);

/* How many processes publish these bodies now: 0 or 1; -1 when it failed. */
int edgecap_bodies_publishers(edgecap_bodies *reader);

/* Closes a reader, and its frame is gone with it: 0; -1 when it failed, as in another thread than the reader's: then it
 * is still open.  NULL is no reader, and nothing happens. */
int edgecap_bodies_close(edgecap_bodies *reader);

/* The same for what has happened.  Silence is no failure: a frame comes when something has.  A reader begins with the
 * newest, however old it is. */
edgecap_events *edgecap_events_open(const char *camera);
int edgecap_events_next(edgecap_events *reader, uint32_t timeout_ms, const edgecap_event_frame **frame);
int edgecap_events_newest(edgecap_events *reader, uint32_t timeout_ms, const edgecap_event_frame **frame);
int edgecap_events_publishers(edgecap_events *reader);
int edgecap_events_close(edgecap_events *reader);

/* The same for observations. */
edgecap_observations *edgecap_observations_open(const char *camera);
int edgecap_observations_next(edgecap_observations *reader, uint32_t timeout_ms, const edgecap_observation_frame **frame);
int edgecap_observations_newest(edgecap_observations *reader, uint32_t timeout_ms, const edgecap_observation_frame **frame);
int edgecap_observations_publishers(edgecap_observations *reader);
int edgecap_observations_close(edgecap_observations *reader);

/* The same for how the camera is doing. */
edgecap_health *edgecap_health_open(const char *camera);
int edgecap_health_next(edgecap_health *reader, uint32_t timeout_ms, const edgecap_health_frame **frame);
int edgecap_health_newest(edgecap_health *reader, uint32_t timeout_ms, const edgecap_health_frame **frame);
int edgecap_health_publishers(edgecap_health *reader);
int edgecap_health_close(edgecap_health *reader);

/* Takes a body of a frame to the floor-aligned world: 1 when `there` was written, 0 while no floor is known, -1 when it failed. */
int edgecap_in_world(const edgecap_body_frame *frame, const edgecap_body *body, edgecap_world_body *there);

/* Names, such as "r_wrist", "r_elbow_flexion", VRM's "rightLowerArm", "zone_entered", "away" and "behind"; NULL for
 * numbers that are none. */
const char *edgecap_joint_name(uint32_t joint);
const char *edgecap_angle_name(uint32_t angle);
const char *edgecap_bone_name(uint32_t bone);
const char *edgecap_event_name(uint32_t kind);
const char *edgecap_health_state_name(uint32_t state);
const char *edgecap_health_pace_name(uint32_t pace);

/* The joint that a joint's bone starts in (the pelvis is its own parent), and the bone that carries a bone (the hips carry
 * themselves); -1 for numbers that are none. */
int edgecap_joint_parent(uint32_t joint);
int edgecap_bone_parent(uint32_t bone);

/* Other layouts: the names of COCO's keypoints and of Azure Kinect's joints (without K4ABT_JOINT_), in their order, and
 * the enum edgecap_joint for each.  NULL and -1 for numbers that are none; -1 also where no joint of ours fits, as in the
 * face.  Left and right are the person's own in all. */
const char *edgecap_coco_name(uint32_t keypoint);
const char *edgecap_kinect_name(uint32_t joint);
int edgecap_coco_joint(uint32_t keypoint);
int edgecap_kinect_joint(uint32_t joint);

/* Why this thread's last call with a reader or a frame failed, one line; "" when it did not.  Valid until the next such call. */
const char *edgecap_error(void);

#ifdef __cplusplus
}
#endif

#endif
