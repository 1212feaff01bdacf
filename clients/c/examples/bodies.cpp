// Prints where everybody's right wrist is. In this folder, after `cargo build --release -p edgecap-c`:
// c++ -std=c++11 bodies.cpp -I../include -L../../../target/release -ledgecap_c -Wl,-rpath,$PWD/../../../target/release -o bodies
#include <edgecap.hpp>

#include <iostream>

int main(int argc, char **argv) try {
    edgecap::Bodies reader(argc > 1 ? argv[1] : "camera0");
    for (;;) {
        const edgecap_body_frame *frame = reader.next();
        if (!frame)
            continue;
        for (const edgecap::Body &body : edgecap::people(*frame)) {
            const float *wrist = body.joints3d[EDGECAP_R_WRIST];
            std::cout << frame->sequence << " #" << body.id << " " << wrist[0] << " " << wrist[1] << " " << wrist[2] << " m"
                      << std::endl;
        }
        if (edgecap::is_last(*frame))
            return 0;
    }
} catch (const edgecap::Error &error) {
    std::cerr << "bodies: " << error.what() << std::endl;
    return 1;
}
