// The reader in C++ of the conformance test: every field of every frame.
#include <edgecap.hpp>

#include <cstring>
#include <iomanip>
#include <iostream>
#include <string>

namespace {

template <typename T> void line(const std::string &label, std::initializer_list<T> values) {
    std::cout << label;
    for (const T &v : values)
        std::cout << ' ' << v;
    std::cout << '\n';
}

std::string bits(float v) {
    uint32_t b;
    std::memcpy(&b, &v, sizeof b);
    char text[10];
    std::snprintf(text, sizeof text, " %08x", static_cast<unsigned>(b));
    return text;
}

// Numbers, and tables of them.
void put(float v) { std::cout << bits(v); }
template <typename T, std::size_t N> void put(const T (&values)[N]) {
    for (const T &v : values)
        put(v);
}
template <typename T> void bits_of(const std::string &label, const T &field) {
    std::cout << label;
    put(field);
    std::cout << '\n';
}

void more(float v) { std::cout << ' ' << v; }
template <typename T, std::size_t N> void more(const T (&values)[N]) {
    for (const T &v : values)
        more(v);
}

template <typename F> void names(const std::string &label, uint32_t count, F name) {
    std::cout << label;
    for (uint32_t i = 0; i < count; i++)
        std::cout << ' ' << name(i);
    std::cout << '\n';
}

// The words that the other readers have.
const char *word(edgecap_body_state state) {
    return state == EDGECAP_BODY_TRACKED ? "tracked" : state == EDGECAP_BODY_PREDICTED ? "predicted" : "tentative";
}
const char *word(edgecap_joint_state state) {
    return state == EDGECAP_JOINT_OBSERVED ? "observed" : state == EDGECAP_JOINT_OCCLUDED ? "occluded" : "predicted";
}
const char *word(edgecap_world_state state) {
    return state == EDGECAP_WORLD_GIVEN ? "given" : state == EDGECAP_WORLD_ESTIMATED ? "estimated" : "none";
}

const char *word(edgecap_hand hand) {
    return hand == EDGECAP_HAND_LEFT ? "left" : hand == EDGECAP_HAND_RIGHT ? "right" : "none";
}

void print(const edgecap_body_frame &frame, const edgecap::Body &b) {
    line("id", {b.id});
    line("state", {word(static_cast<edgecap_body_state>(b.state))});
    bits_of("score", b.score);
    bits_of("position", b.position);
    bits_of("orientation", b.orientation);
    bits_of("velocity", b.velocity);
    bits_of("angles", b.angles);
    bits_of("joints3d", b.joints3d);
    bits_of("joints2d", b.joints2d);
    bits_of("confidence", b.confidence);
    bits_of("height", b.height);
    bits_of("bone_lengths", b.bone_lengths);
    bits_of("bone_rotations", b.bone_rotations);
    std::cout << "joint_states";
    for (const uint8_t state : b.joint_states)
        std::cout << ' ' << word(static_cast<edgecap_joint_state>(state));
    std::cout << '\n';
    edgecap::WorldBody there;
    if (edgecap::in_world(frame, b, there)) {
        std::cout << "~there";
        more(there.position);
        more(there.orientation);
        more(there.velocity);
        more(there.joints3d);
        std::cout << '\n';
    }
}

void print(const edgecap_stage_times &t) {
    line("stages", {t.preprocess_us, t.stage1_us, t.association_us, t.stage2_us});
}

void print(const edgecap_body_frame &f) {
    line("sequence", {f.sequence});
    line("times", {f.capture_ns, f.pose_ns, f.publish_ns});
    line("size", {f.width, f.height});
    const float intrinsics[] = {f.intrinsics.fx, f.intrinsics.fy, f.intrinsics.cx, f.intrinsics.cy};
    bits_of("intrinsics", intrinsics);
    print(f.stage_times);
    line("fit", {f.fit_us});
    line("flags", {f.flags});
    line("count", {f.count, f.frame_total});
    std::cout << "world";
    put(f.world.rotation);
    put(f.world.translation);
    std::cout << '\n';
    line("floor", {word(static_cast<edgecap_world_state>(f.world.state))});
    for (const edgecap::Body &body : edgecap::people(f))
        print(f, body);
}

void print(const edgecap_observation_frame &f) {
    line("seen", {f.sequence});
    line("times", {f.capture_ns, f.publish_ns});
    line("size", {f.width, f.height});
    const float intrinsics[] = {f.intrinsics.fx, f.intrinsics.fy, f.intrinsics.cx, f.intrinsics.cy};
    bits_of("intrinsics", intrinsics);
    print(f.stage_times);
    line("flags", {f.flags});
    line("count", {f.count, f.frame_total, f.without_neck});
    for (const edgecap::Observation &p : edgecap::people(f)) {
        bits_of("score", p.score);
        bits_of("joints2d", p.joints2d);
        bits_of("joints3d", p.joints3d);
        bits_of("hue", p.hue);
        bits_of("saturation", p.saturation);
    }
}

void print(const edgecap_event_frame &f) {
    line("happened", {f.sequence});
    line("times", {f.time_ns, f.publish_ns});
    line("first", {f.first});
    line("flags", {f.flags});
    line("count", {f.count, f.present, f.main_person});
    for (const edgecap::Event &e : edgecap::events(f)) {
        line("event", {edgecap_event_name(e.kind)});
        line("person", {e.person});
        bits_of("seconds", e.seconds);
        line("hand", {word(static_cast<edgecap_hand>(e.hand))});
        std::cout << "zone" << (e.zone[0] ? " " : "") << e.zone << '\n';
    }
}

void print(const edgecap_health_frame &f) {
    line("health", {edgecap_health_state_name(f.state)});
    line("pace", {edgecap_health_pace_name(f.pace)});
    line("times", {f.publish_ns, f.started_ns, f.since_ns, f.capture_ns});
    line("counts", {f.sequence, f.observed, f.left_out});
    line("flags", {f.flags});
    const float rates[] = {f.source_hz, f.observed_hz, f.look_hz};
    bits_of("rates", rates);
    line("latency", {f.latency_us});
    line("people", {f.people});
    line("input", {f.input_width, f.input_height});
    line("again", {f.reconnects, f.restarts});
    line("cameras", {f.cameras, f.cameras_live});
}

template <typename Reader> void read(Reader &reader) {
    for (bool is_last = false; !is_last;) {
        if (const auto *frame = reader.next()) {
            print(*frame);
            is_last = edgecap::is_last(*frame);
        }
    }
}

} // namespace

int main(int argc, char **argv) try {
    const char *camera = argc > 1 ? argv[1] : "camera0";
    edgecap::Bodies bodies(camera);
    edgecap::Observations observations(camera);
    edgecap::Events events(camera);
    edgecap::Health health(camera);
    std::cout << "ready" << std::endl << std::setprecision(9);
    names("joints", EDGECAP_BODY_JOINTS, edgecap_joint_name);
    names("parents", EDGECAP_BODY_JOINTS, edgecap_joint_parent);
    names("angles", EDGECAP_DOF, edgecap_angle_name);
    names("bones", EDGECAP_BONES, edgecap_bone_name);
    names("carriers", EDGECAP_BONES, edgecap_bone_parent);
    names("coco", EDGECAP_COCO_KEYPOINTS, [](uint32_t i) {
        return edgecap_coco_name(i) + ("=" + std::to_string(edgecap_coco_joint(i)));
    });
    names("kinect", EDGECAP_KINECT_JOINTS, [](uint32_t i) {
        return edgecap_kinect_name(i) + ("=" + std::to_string(edgecap_kinect_joint(i)));
    });
    names("events", EDGECAP_EVENT_MAIN_PERSON + 1, edgecap_event_name);
    read(bodies);
    read(observations);
    read(events);
    read(health);
    return 0;
} catch (const edgecap::Error &error) {
    std::cerr << "print: " << error.what() << std::endl;
    return 1;
}
