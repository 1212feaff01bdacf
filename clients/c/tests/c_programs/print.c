/* The reader in C of the conformance test: every field of every frame. */
#include <edgecap.h>
#include <stdio.h>
#include <string.h>

static void bits(const char *label, const void *values, size_t size) {
    size_t i;
    printf("%s", label);
    for (i = 0; i < size / sizeof(float); i++) {
        uint32_t v;
        memcpy(&v, (const char *)values + i * sizeof v, sizeof v);
        printf(" %08x", (unsigned)v);
    }
    puts("");
}

#define BITS(label, field) bits(label, &(field), sizeof(field))

/* The words that the other readers have. */
static const char *const BODY[] = {
    [EDGECAP_BODY_TENTATIVE] = "tentative", [EDGECAP_BODY_TRACKED] = "tracked", [EDGECAP_BODY_PREDICTED] = "predicted"};
static const char *const JOINT[] = {[EDGECAP_JOINT_PREDICTED] = "predicted",
                                    [EDGECAP_JOINT_OCCLUDED] = "occluded",
                                    [EDGECAP_JOINT_OBSERVED] = "observed"};
static const char *const FLOOR[] = {
    [EDGECAP_WORLD_NONE] = "none", [EDGECAP_WORLD_ESTIMATED] = "estimated", [EDGECAP_WORLD_GIVEN] = "given"};

static const char *const HAND[] = {
    [EDGECAP_HAND_NONE] = "none", [EDGECAP_HAND_LEFT] = "left", [EDGECAP_HAND_RIGHT] = "right"};

static void more(const float *values, size_t count) {
    size_t i;
    for (i = 0; i < count; i++)
        printf(" %.9g", values[i]);
}

static void print_names(void) {
    uint32_t i;
    printf("joints");
    for (i = 0; edgecap_joint_name(i); i++)
        printf(" %s", edgecap_joint_name(i));
    printf("\nparents");
    for (i = 0; edgecap_joint_parent(i) >= 0; i++)
        printf(" %d", edgecap_joint_parent(i));
    printf("\nangles");
    for (i = 0; edgecap_angle_name(i); i++)
        printf(" %s", edgecap_angle_name(i));
    printf("\nbones");
    for (i = 0; edgecap_bone_name(i); i++)
        printf(" %s", edgecap_bone_name(i));
    printf("\ncarriers");
    for (i = 0; edgecap_bone_parent(i) >= 0; i++)
        printf(" %d", edgecap_bone_parent(i));
    printf("\ncoco");
    for (i = 0; edgecap_coco_name(i); i++)
        printf(" %s=%d", edgecap_coco_name(i), edgecap_coco_joint(i));
    printf("\nkinect");
    for (i = 0; edgecap_kinect_name(i); i++)
        printf(" %s=%d", edgecap_kinect_name(i), edgecap_kinect_joint(i));
    printf("\nevents");
    for (i = 0; edgecap_event_name(i); i++)
        printf(" %s", edgecap_event_name(i));
    puts("");
}

static void print_body(const edgecap_body_frame *frame, const edgecap_body *b) {
    edgecap_world_body there;
    int j;
    printf("id %u\nstate %s\n", b->id, BODY[b->state]);
    BITS("score", b->score);
    BITS("position", b->position);
    BITS("orientation", b->orientation);
    BITS("velocity", b->velocity);
    BITS("angles", b->angles);
    BITS("joints3d", b->joints3d);
    BITS("joints2d", b->joints2d);
    BITS("confidence", b->confidence);
    BITS("height", b->height);
    BITS("bone_lengths", b->bone_lengths);
    BITS("bone_rotations", b->bone_rotations);
    printf("joint_states");
    for (j = 0; j < EDGECAP_BODY_JOINTS; j++)
        printf(" %s", JOINT[b->joint_states[j]]);
    puts("");
    if (edgecap_in_world(frame, b, &there) == 1) {
        printf("~there");
        more(there.position, 3);
        more(there.orientation, 4);
        more(there.velocity, 3);
        for (j = 0; j < EDGECAP_BODY_JOINTS; j++)
            more(there.joints3d[j], 3);
        puts("");
    }
}

typedef unsigned long long number;

static void print_stages(const edgecap_stage_times *t) {
    printf("stages %u %u %u %u\n", t->preprocess_us, t->stage1_us, t->association_us, t->stage2_us);
}

static void print_frame(const edgecap_body_frame *f) {
    uint32_t i;
    printf("sequence %llu\n", (number)f->sequence);
    printf("times %llu %llu %llu\n", (number)f->capture_ns, (number)f->pose_ns, (number)f->publish_ns);
    printf("size %u %u\n", f->width, f->height);
    BITS("intrinsics", f->intrinsics);
    print_stages(&f->stage_times);
    printf("fit %u\n", f->fit_us);
    printf("flags %u\ncount %u %u\n", f->flags, f->count, f->frame_total);
    bits("world", f->world.rotation, sizeof f->world.rotation + sizeof f->world.translation);
    printf("floor %s\n", FLOOR[f->world.state]);
    for (i = 0; i < f->count; i++)
        print_body(f, &f->bodies[i]);
}

static void print_observations(const edgecap_observation_frame *f) {
    uint32_t i;
    printf("seen %llu\n", (number)f->sequence);
    printf("times %llu %llu\n", (number)f->capture_ns, (number)f->publish_ns);
    printf("size %u %u\n", f->width, f->height);
    BITS("intrinsics", f->intrinsics);
    print_stages(&f->stage_times);
    printf("flags %u\ncount %u %u %u\n", f->flags, f->count, f->frame_total, f->without_neck);
    for (i = 0; i < f->count; i++) {
        const edgecap_observation *p = &f->people[i];
        BITS("score", p->score);
        BITS("joints2d", p->joints2d);
        BITS("joints3d", p->joints3d);
        BITS("hue", p->hue);
        BITS("saturation", p->saturation);
    }
}

static void print_events(const edgecap_event_frame *f) {
    uint32_t i;
    printf("happened %llu\n", (number)f->sequence);
    printf("times %llu %llu\n", (number)f->time_ns, (number)f->publish_ns);
    printf("first %llu\nflags %u\n", (number)f->first, f->flags);
    printf("count %u %u %u\n", f->count, f->present, f->main_person);
    for (i = 0; i < f->count; i++) {
        const edgecap_event *e = &f->events[i];
        printf("event %s\nperson %u\n", edgecap_event_name(e->kind), e->person);
        BITS("seconds", e->seconds);
        printf("hand %s\nzone%s%s\n", HAND[e->hand], e->zone[0] ? " " : "", e->zone);
    }
}

static void print_health(const edgecap_health_frame *f) {
    const float rates[] = {f->source_hz, f->observed_hz, f->look_hz};
    printf("health %s\npace %s\n", edgecap_health_state_name(f->state), edgecap_health_pace_name(f->pace));
    printf("times %llu %llu", (number)f->publish_ns, (number)f->started_ns);
    printf(" %llu %llu\n", (number)f->since_ns, (number)f->capture_ns);
    printf("counts %llu %llu %llu\n", (number)f->sequence, (number)f->observed, (number)f->left_out);
    printf("flags %u\n", f->flags);
    bits("rates", rates, sizeof rates);
    printf("latency %u\npeople %u\ninput %u %u\n", f->latency_us, f->people, f->input_width, f->input_height);
    printf("again %u %u\ncameras %u %u\n", f->reconnects, f->restarts, f->cameras, f->cameras_live);
}

/* Reads a stream to its end. */
#define READ(kind, reader, type, print)                                                                                \
    do {                                                                                                               \
        const type *f;                                                                                                 \
        int got, is_last = 0;                                                                                          \
        while (!is_last && (got = edgecap_##kind##_next(reader, 1000, &f)) >= 0)                                       \
            if (got == 1) {                                                                                            \
                print(f);                                                                                              \
                is_last = (f->flags & EDGECAP_END_OF_STREAM) != 0;                                                     \
            }                                                                                                          \
        failed |= !is_last;                                                                                            \
    } while (0)

int main(int argc, char **argv) {
    const char *camera = argc > 1 ? argv[1] : "camera0";
    edgecap_bodies *bodies = edgecap_bodies_open(camera);
    edgecap_observations *observations = edgecap_observations_open(camera);
    edgecap_events *events = edgecap_events_open(camera);
    edgecap_health *health = edgecap_health_open(camera);
    int failed = !bodies || !observations || !events || !health;
    if (!failed) {
        puts("ready");
        fflush(stdout);
        print_names();
        READ(bodies, bodies, edgecap_body_frame, print_frame);
        READ(observations, observations, edgecap_observation_frame, print_observations);
        READ(events, events, edgecap_event_frame, print_events);
        READ(health, health, edgecap_health_frame, print_health);
    }
    if (failed)
        fprintf(stderr, "print: %s\n", edgecap_error());
    edgecap_bodies_close(bodies);
    edgecap_observations_close(observations);
    edgecap_events_close(events);
    edgecap_health_close(health);
    return failed;
}
