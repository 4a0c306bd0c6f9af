//! A frontend in one file: odometry that drifts, an RGB-D camera, a loop, corrections.
//!
//! Start a server (`covis serve`), then `first_frontend [URL]`. Tracking is played by arithmetic, as in
//! examples/first_frontend.rs: a robot drives along a wall of known points and back, and its odometry
//! is off by 4 %.

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>

#include "covis/covis.hpp"

namespace {

constexpr double kFocalPx = 525.0;
constexpr double kCenterPx[2] = {319.5, 239.5};
/// Keyframes of the drive, there and back.
constexpr std::int64_t kKeyframes = 24;

/// Numbers between -1 and 1 that look random and are the same in every run.
double noise(std::int64_t a, std::int64_t b) {
    const auto seed = static_cast<std::uint64_t>(a * 7919 + b * 104'729 + 17);
    const auto mixed = static_cast<std::int64_t>(seed * 0x9E37'79B9'7F4A'7C15ULL);
    return static_cast<double>((mixed >> 20) & 0xffff) / 32'768.0 - 1.0;
}

/// Where the camera really is: along the wall and back, 15 cm a keyframe.
double true_x(std::int64_t keyframe) {
    return 0.15 * static_cast<double>(std::min(keyframe, kKeyframes - 1 - keyframe));
}

/// Where odometry says that it is: 4 % too far on the way there, too short on the way back.
double odom_x(std::int64_t keyframe) {
    const std::int64_t turn = (kKeyframes - 1) / 2;
    return 1.04 * true_x(std::min(keyframe, turn)) +
           0.96 * (true_x(std::max(keyframe, turn)) - true_x(turn));
}

covis::Pose at(double x) { return {{x, 0.0, 0.0}, {0.0, 0.0, 0.0, 1.0}}; }

/// What the camera sees of ten points in each column of an uneven wall about 3 m away. On the way back
/// the tracking takes the wall for new: its landmarks have other ids.
std::vector<covis::Observation> look(std::int64_t keyframe) {
    const std::int64_t first = keyframe < kKeyframes / 2 ? 0 : 10'000;
    const auto column = std::llround(true_x(keyframe) / 0.15);
    std::vector<covis::Observation> seen;
    for (std::int64_t id = column * 10; id < (column + 16) * 10; ++id) {
        const double x = 0.15 * static_cast<double>(id / 10 - 8) - true_x(keyframe);
        const double y = -0.9 + 0.2 * static_cast<double>(id % 10);
        const double z = 3.0 + 0.3 * noise(id, 7);
        covis::Observation observation;
        observation.landmark = first + id;
        observation.u = kFocalPx * x / z + kCenterPx[0] + noise(keyframe, observation.landmark);
        observation.v = kFocalPx * y / z + kCenterPx[1] + noise(observation.landmark, keyframe);
        // Without a sigma of its own the depth has that of a Kinect.
        observation.depth_m = z + covis::kinect_sigma_m(z) * noise(keyframe + 1, observation.landmark);
        seen.push_back(observation);
    }
    return seen;
}

void drive(const char* url) {
    auto client = covis::Client::connect(url);
    // The session numbers items, keeps those without an answer and sends them again after a break.
    auto session = client.ingest("first", "robot");
    covis::WatchOptions few;
    few.omit_landmarks = true;
    auto map = client.watch("first", few);

    session.camera(covis::pinhole(0, 640, 480, kFocalPx, kFocalPx, kCenterPx[0], kCenterPx[1]));
    const double sigma_rad = 0.5 * std::acos(-1.0) / 180.0;
    for (std::int64_t id = 0; id < kKeyframes; ++id) {
        covis::Keyframe keyframe;
        keyframe.id = id;
        keyframe.capture_time = std::chrono::seconds(1'700'000'000 + id);
        keyframe.odom_from_camera = at(odom_x(id));
        // Where the robot is in the map, as far as it is known now.
        keyframe.world_from_camera =
            map.map_from_odom("robot").value_or(covis::Pose()) * *keyframe.odom_from_camera;
        keyframe.observations = look(id);
        session.keyframe(keyframe);
        if (id > 0) {
            const double step = odom_x(id) - odom_x(id - 1);
            const double sigma_m = 0.05 * std::abs(step) + 0.005;
            session.odometry(id, id - 1, id, at(step), covis::closure_information(sigma_m, sigma_rad));
        }
    }
    // The robot is back and recognizes where it began.
    const std::int64_t last = kKeyframes - 1;
    session.closure(0, 0, last, at(true_x(last) - true_x(0)), covis::closure_information(0.01, sigma_rad));

    // All acks, also those of the last solve; then the mirror has what they were about.
    const auto report = session.finish();
    map.wait(report.revision);
    for (const auto& [ref, pose] : map.poses()) {
        std::printf("keyframe %2d: odometry %.3f m, map %.3f m, truth %.3f m\n", static_cast<int>(ref.id),
                    odom_x(ref.id), pose.translation[0], true_x(ref.id));
    }
}

}  // namespace

int main(int count, char** arguments) {
    try {
        drive(count > 1 ? arguments[1] : "http://127.0.0.1:7411");
        return 0;
    } catch (const covis::Error& error) {
        std::fprintf(stderr, "error: %s\n", error.what());
        return 1;
    }
}
