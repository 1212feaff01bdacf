/* Prints where everybody's right wrist is. In this folder, after `cargo build --release -p edgecap-c`:
 * cc bodies.c -I../include -L../../../target/release -ledgecap_c -Wl,-rpath,$PWD/../../../target/release -o bodies
 */
#include <edgecap.h>
#include <stdio.h>

int main(int argc, char **argv) {
    edgecap_bodies *reader = edgecap_bodies_open(argc > 1 ? argv[1] : "camera0");
    const edgecap_body_frame *frame;
    int got = reader ? 0 : -1;
    while (got >= 0) {
        got = edgecap_bodies_next(reader, 1000, &frame);
        if (got < 1)
            continue;
        for (uint32_t i = 0; i < frame->count && i < EDGECAP_MAX_PEOPLE; i++) {
            const float *wrist = frame->bodies[i].joints3d[EDGECAP_R_WRIST];
            printf("%llu #%u %.2f %.2f %.2f m\n", (unsigned long long)frame->sequence, frame->bodies[i].id, wrist[0], wrist[1], wrist[2]);
        }
        fflush(stdout);
        /* A camera's run that has stopped may come back; a file does not. */
        if ((frame->flags & EDGECAP_END_OF_FILE) == EDGECAP_END_OF_FILE)
            break;
    }
    if (got < 0)
        fprintf(stderr, "bodies: %s\n", edgecap_error());
    edgecap_bodies_close(reader);
    return got < 0;
}
