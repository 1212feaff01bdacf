// Read edgecap's bodies, events, observations and health from shared memory in C++11 or newer;
// clients/c/examples/bodies.cpp is a whole program.
//
// What edgecap.h says of fields, frames and threads holds here, too. Failures are edgecap::Error.
#ifndef EDGECAP_HPP
#define EDGECAP_HPP

#include <edgecap.h>

#include <chrono>
#include <cstddef>
#include <cstdio>
#include <memory>
#include <stdexcept>
#include <string>

namespace edgecap {

using Body = edgecap_body;
using WorldBody = edgecap_world_body;
using Event = edgecap_event;
using Observation = edgecap_observation;

// Why a call failed, and what to do, in one line.
class Error : public std::runtime_error {
public:
    explicit Error(const std::string &text) : std::runtime_error(text) {}
};

// The valid entries of a frame: for (const edgecap::Body &body : edgecap::people(*frame)).
template <typename T> class Entries {
public:
    Entries(const T *first, std::size_t count, std::size_t most) : first_(first), size_(count < most ? count : most) {}
    const T *begin() const { return first_; }
    const T *end() const { return first_ + size_; }
    std::size_t size() const { return size_; }

private:
    const T *first_;
    std::size_t size_;
};
using People = Entries<Body>;

// Bodies by rising id, observations by falling score, events in the order in which they were certain.
inline People people(const edgecap_body_frame &frame) { return {frame.bodies, frame.count, EDGECAP_MAX_PEOPLE}; }
inline Entries<Observation> people(const edgecap_observation_frame &frame) {
    return {frame.people, frame.count, EDGECAP_MAX_PEOPLE};
}
inline Entries<Event> events(const edgecap_event_frame &frame) { return {frame.events, frame.count, EDGECAP_MAX_EVENTS}; }

// Whether a file has ended: this frame holds nothing new, and none follows. A camera's run that stops may come back.
template <typename Frame> bool is_last(const Frame &frame) {
    return (frame.flags & EDGECAP_END_OF_FILE) == EDGECAP_END_OF_FILE;
}

// Takes a body of a frame to the floor-aligned world; false, and nothing written, while no floor is known.
inline bool in_world(const edgecap_body_frame &frame, const Body &body, WorldBody &there) {
    const int found = edgecap_in_world(&frame, &body, &there);
    if (found < 0)
        throw Error(edgecap_error());
    return found == 1;
}

// The calls of one kind of reader.
template <typename Handle, typename Frame> struct Calls {
    Handle *(*open)(const char *);
    int (*next)(Handle *, uint32_t, const Frame **);
    int (*newest)(Handle *, uint32_t, const Frame **);
    int (*publishers)(Handle *);
    int (*close)(Handle *);
};

// Closes a reader that is let go of. A destructor has nobody to tell but the terminal.
template <typename Handle> struct Close {
    int (*close)(Handle *);
    void operator()(Handle *reader) const {
        if (close(reader) < 0)
            std::fprintf(stderr, "edgecap: a reader was not closed: %s\n", edgecap_error());
    }
};

// A reader of one camera's stream, which need not run yet. It belongs to the thread that made it.
template <typename Handle, typename Frame> class Reader {
public:
    // The oldest frame not yet read, waiting up to `timeout` for one; null when none came. It lies in shared memory, is
    // read-only, and is valid until the next call with this reader.
    const Frame *next(std::chrono::milliseconds timeout = std::chrono::milliseconds(1000)) {
        return read(calls_.next, timeout);
    }

    // The newest frame; older unread ones are thrown away. Otherwise as next().
    const Frame *newest(std::chrono::milliseconds timeout = std::chrono::milliseconds(1000)) {
        return read(calls_.newest, timeout);
    }

    // How many processes publish this stream now: 0 or 1.
    int publishers() {
        const int count = calls_.publishers(reader_.get());
        if (count < 0)
            throw Error(edgecap_error());
        return count;
    }

protected:
    Reader(const std::string &camera, const Calls<Handle, Frame> &calls)
        : calls_(calls), reader_(calls.open(camera.c_str()), Close<Handle>{calls.close}) {
        if (!reader_)
            throw Error(edgecap_error());
    }

private:
    const Frame *read(int (*how)(Handle *, uint32_t, const Frame **), std::chrono::milliseconds timeout) {
        const Frame *frame = nullptr;
        const auto wait = timeout.count() < 0 ? 0 : timeout.count() > UINT32_MAX ? UINT32_MAX : timeout.count();
        const int got = how(reader_.get(), static_cast<uint32_t>(wait), &frame);
        if (got < 0)
            throw Error(edgecap_error());
        return got == 1 ? frame : nullptr;
    }

    Calls<Handle, Frame> calls_;
    std::unique_ptr<Handle, Close<Handle>> reader_;
};

// Everybody with an identity.
class Bodies : public Reader<edgecap_bodies, edgecap_body_frame> {
public:
    explicit Bodies(const std::string &camera = "camera0")
        : Reader(camera, {edgecap_bodies_open, edgecap_bodies_next, edgecap_bodies_newest, edgecap_bodies_publishers,
                          edgecap_bodies_close}) {}
};

// What has happened. Silence is no failure: a frame comes when something has.
class Events : public Reader<edgecap_events, edgecap_event_frame> {
public:
    explicit Events(const std::string &camera = "camera0")
        : Reader(camera, {edgecap_events_open, edgecap_events_next, edgecap_events_newest, edgecap_events_publishers,
                          edgecap_events_close}) {}
};

// Everybody as seen in one picture, before the fit.
class Observations : public Reader<edgecap_observations, edgecap_observation_frame> {
public:
    explicit Observations(const std::string &camera = "camera0")
        : Reader(camera, {edgecap_observations_open, edgecap_observations_next, edgecap_observations_newest,
                          edgecap_observations_publishers, edgecap_observations_close}) {}
};

// How the camera is doing, at every change and about once a second.
class Health : public Reader<edgecap_health, edgecap_health_frame> {
public:
    explicit Health(const std::string &camera = "camera0")
        : Reader(camera, {edgecap_health_open, edgecap_health_next, edgecap_health_newest, edgecap_health_publishers,
                          edgecap_health_close}) {}
};

} // namespace edgecap

#endif
