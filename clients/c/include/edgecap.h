/* Read edgecap's bodies from shared memory in C99 or C++11; clients/c/examples/bodies.c is a whole program, edgecap.hpp
 * wraps this for C++.
 *
 * Camera frame: x right, y down, z forward, metres; pixels are those of the original picture, pixel centres on integers;
 * quaternions are xyzw; times are CLOCK_MONOTONIC nanoseconds.  The structures mirror clients/rust/src/message.rs, whose
 * layout a test holds against this file.
 *
 * A reader belongs to the thread that opened it; calls from another one fail.  A program may have several readers, and
 * any number may read one camera.  Failures are told by edgecap_error() in one line. */
#ifndef EDGECAP_H
#define EDGECAP_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define EDGECAP_MAX_PEOPLE 32
#define EDGECAP_BODY_JOINTS 21
#define EDGECAP_DOF 29
#define EDGECAP_BONES 16

/* Indices of joints. */
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

/* Bits of edgecap_body_frame.flags. */
enum edgecap_flag {
    EDGECAP_END_OF_STREAM = 1, /* the input has ended, this frame holds nobody new */
    EDGECAP_FILE_TIME = 2      /* capture_ns is a file's presentation time, not CLOCK_MONOTONIC */
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
    uint32_t id;          /* from 1, never reused while `fit` runs */
    uint32_t state;       /* enum edgecap_body_state */
    float score;          /* overall confidence, 0 to 1 */
    float position[3];    /* pelvis in camera space, metres */
    float orientation[4]; /* of the pelvis, from rest axes (x to the person's left, y up, z front) to camera axes, xyzw */
    float velocity[3];    /* of the pelvis, metres per second */
    float angles[EDGECAP_DOF]; /* root translation (m) and rotation vector (rad), 23 joint angles (rad); edgecap_angle_name */
    float joints3d[EDGECAP_BODY_JOINTS][3];    /* camera space, metres */
    float joints2d[EDGECAP_BODY_JOINTS][2];    /* the same in the original picture, pixels */
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
    uint64_t sequence;   /* of the newest picture behind this frame, from 0 */
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

/* A reader of one camera's bodies. */
typedef struct edgecap_bodies edgecap_bodies;

/* Connects to the bodies of the run with this --name ("camera0" when it was given none), which need not run yet.
 * NULL when that fails. */
edgecap_bodies *edgecap_bodies_open(const char *camera);

/* The oldest frame not yet read, waiting up to timeout_ms for one: 1 and the frame; 0 when none came (it may come back a
 * little early: call again); -1 when it failed.  The frame lies in shared memory, is read-only, and is valid until the next call
 * with this reader.  A reader that is more than 16 frames behind loses the oldest. */
int edgecap_bodies_next(edgecap_bodies *reader, uint32_t timeout_ms, const edgecap_body_frame **frame);

/* The newest frame; older unread ones are thrown away.  Otherwise as edgecap_bodies_next. */
int edgecap_bodies_newest(edgecap_bodies *reader, uint32_t timeout_ms, const edgecap_body_frame **frame);

/* How many processes publish these bodies now: 0 or 1; -1 when it failed. */
int edgecap_bodies_publishers(edgecap_bodies *reader);

/* Frees what killed processes left behind: call it every few seconds in a program that runs for weeks. */
void edgecap_bodies_clean_up(edgecap_bodies *reader);

/* Closes a reader; its frame is gone with it.  NULL is no reader, and nothing happens. */
void edgecap_bodies_close(edgecap_bodies *reader);

/* Takes a body of a frame to the floor-aligned world: 1 when `there` was written, 0 while no floor is known, -1 when it failed. */
int edgecap_in_world(const edgecap_body_frame *frame, const edgecap_body *body, edgecap_world_body *there);

/* Names, such as "r_wrist", "r_elbow_flexion" and VRM's "rightLowerArm"; NULL for numbers that are none. */
const char *edgecap_joint_name(uint32_t joint);
const char *edgecap_angle_name(uint32_t angle);
const char *edgecap_bone_name(uint32_t bone);

/* The joint that a joint's bone starts in (the pelvis is its own parent), and the bone that carries a bone (the hips carry
 * themselves); -1 for numbers that are none. */
int edgecap_joint_parent(uint32_t joint);
int edgecap_bone_parent(uint32_t bone);

/* Why this thread's last call with a reader or a frame failed, one line; "" when it did not.  Valid until the next such call. */
const char *edgecap_error(void);

#ifdef __cplusplus
}
#endif

#endif
