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

static void print_frame(const edgecap_body_frame *f) {
    typedef unsigned long long number;
    const edgecap_stage_times *t = &f->stage_times;
    uint32_t i;
    printf("sequence %llu\n", (number)f->sequence);
    printf("times %llu %llu %llu\n", (number)f->capture_ns, (number)f->pose_ns, (number)f->publish_ns);
    printf("size %u %u\n", f->width, f->height);
    BITS("intrinsics", f->intrinsics);
    printf("stages %u %u %u %u %u\n", t->preprocess_us, t->stage1_us, t->association_us, t->stage2_us, f->fit_us);
    printf("flags %u\ncount %u %u\n", f->flags, f->count, f->frame_total);
    bits("world", f->world.rotation, sizeof f->world.rotation + sizeof f->world.translation);
    printf("floor %s\n", FLOOR[f->world.state]);
    for (i = 0; i < f->count; i++)
        print_body(f, &f->bodies[i]);
}

int main(int argc, char **argv) {
    edgecap_bodies *reader = edgecap_bodies_open(argc > 1 ? argv[1] : "camera0");
    const edgecap_body_frame *frame;
    int got = reader ? 0 : -1, is_last = 0;
    if (reader) {
        puts("ready");
        fflush(stdout);
        print_names();
    }
    while (got >= 0 && !is_last) {
        got = edgecap_bodies_next(reader, 1000, &frame);
        if (got == 1) {
            print_frame(frame);
            is_last = (frame->flags & EDGECAP_END_OF_STREAM) != 0;
        }
    }
    if (got < 0)
        fprintf(stderr, "print: %s\n", edgecap_error());
    edgecap_bodies_close(reader);
    return got < 0;
}
