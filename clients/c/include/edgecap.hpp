// Read edgecap's bodies from shared memory in C++11 or newer; clients/c/examples/bodies.cpp is a whole program.
//
// What edgecap.h says of fields, frames and threads holds here, too. Failures are edgecap::Error.
#ifndef EDGECAP_HPP
#define EDGECAP_HPP

#include <edgecap.h>

#include <chrono>
#include <cstddef>
#include <memory>
#include <stdexcept>
#include <string>

namespace edgecap {

using Body = edgecap_body;
using WorldBody = edgecap_world_body;

// Why a call failed, and what to do, in one line.
class Error : public std::runtime_error {
public:
    explicit Error(const std::string &text) : std::runtime_error(text) {}
};

// The valid bodies of a frame, by rising id: for (const edgecap::Body &body : edgecap::people(*frame)).
class People {
public:
    explicit People(const edgecap_body_frame &frame)
        : first_(frame.bodies), size_(frame.count < EDGECAP_MAX_PEOPLE ? frame.count : EDGECAP_MAX_PEOPLE) {}
    const Body *begin() const { return first_; }
    const Body *end() const { return first_ + size_; }
    std::size_t size() const { return size_; }

private:
    const Body *first_;
    std::size_t size_;
};

inline People people(const edgecap_body_frame &frame) { return People(frame); }

// Whether the input has ended: this frame holds nobody new, and none follows.
inline bool is_last(const edgecap_body_frame &frame) { return (frame.flags & EDGECAP_END_OF_STREAM) != 0; }

// Takes a body of a frame to the floor-aligned world; false, and nothing written, while no floor is known.
inline bool in_world(const edgecap_body_frame &frame, const Body &body, WorldBody &there) {
    const int found = edgecap_in_world(&frame, &body, &there);
    if (found < 0)
        throw Error(edgecap_error());
    return found == 1;
}

// A reader of one camera's bodies, which need not run yet. It belongs to the thread that made it.
class Bodies {
public:
    explicit Bodies(const std::string &camera = "camera0") : reader_(edgecap_bodies_open(camera.c_str())) {
        if (!reader_)
            throw Error(edgecap_error());
    }

    // The oldest frame not yet read, waiting up to `timeout` for one; null when none came. It lies in shared memory, is
    // read-only, and is valid until the next call with this reader.
    const edgecap_body_frame *next(std::chrono::milliseconds timeout = std::chrono::milliseconds(1000)) {
        return read(edgecap_bodies_next, timeout);
    }

    // The newest frame; older unread ones are thrown away. Otherwise as next().
    const edgecap_body_frame *newest(std::chrono::milliseconds timeout = std::chrono::milliseconds(1000)) {
        return read(edgecap_bodies_newest, timeout);
    }

    // How many processes publish these bodies now: 0 or 1.
    int publishers() {
        const int count = edgecap_bodies_publishers(reader_.get());
        if (count < 0)
            throw Error(edgecap_error());
        return count;
    }

    // Frees what killed processes left behind: call it every few seconds in a program that runs for weeks.
    void clean_up() { edgecap_bodies_clean_up(reader_.get()); }

private:
    struct Close {
        void operator()(edgecap_bodies *reader) const { edgecap_bodies_close(reader); }
    };

    const edgecap_body_frame *read(int (*how)(edgecap_bodies *, uint32_t, const edgecap_body_frame **),
                                   std::chrono::milliseconds timeout) {
        const edgecap_body_frame *frame = nullptr;
        const auto wait = timeout.count() < 0 ? 0 : timeout.count() > UINT32_MAX ? UINT32_MAX : timeout.count();
        const int got = how(reader_.get(), static_cast<uint32_t>(wait), &frame);
        if (got < 0)
            throw Error(edgecap_error());
        return got == 1 ? frame : nullptr;
    }

    std::unique_ptr<edgecap_bodies, Close> reader_;
};

} // namespace edgecap

#endif
