//! Arguments to items. What only the server can judge (finite numbers, ranges, references) is left to
//! it. `stream.cpp` moves the items.

#include "covis/session.hpp"

#include <algorithm>
#include <limits>
#include <mutex>
#include <set>

#include "covis/v1/map_service.grpc.pb.h"
#include "settled.hpp"
#include "stream.hpp"

namespace covis {
namespace {

constexpr std::int64_t kNanosPerSecond = 1'000'000'000;

v1::Vector3 vector3(const Vector3& value) {
    v1::Vector3 out;
    out.set_x(value[0]);
    out.set_y(value[1]);
    out.set_z(value[2]);
    return out;
}

v1::KeyframeRef keyframe_ref(const Ref& ref) {
    v1::KeyframeRef out;
    out.set_client_id(ref.client_id);
    out.set_id(ref.id);
    return out;
}

template <class Message, class Packed>
void pack(const Packed& information, Message& into) {
    into.mutable_upper_triangle()->Assign(information.begin(), information.end());
}

void write(const Observation& seen, v1::DescriptorKind kind, const std::string& name,
           v1::Observation& into) {
    into.mutable_landmark()->set_id(seen.landmark);
    into.mutable_pixel()->set_x(seen.u);
    into.mutable_pixel()->set_y(seen.v);
    if (seen.sigma_px) {
        into.set_sigma_px(*seen.sigma_px);
    }
    if (seen.depth_m) {
        into.set_depth_m(*seen.depth_m);
        into.set_sigma_depth_m(seen.sigma_depth_m.value_or(kinect_sigma_m(*seen.depth_m)));
    } else if (seen.sigma_depth_m) {
        throw Error(ErrorKind::kArgument, "sigma_depth_m is that of a depth, which is missing");
    }
    if (!seen.descriptor.empty()) {
        auto& descriptor = *into.mutable_descriptor();
        descriptor.set_kind(kind);
        descriptor.set_name(name);
        descriptor.set_data(seen.descriptor);
    }
}

v1::IngestRequest relative_pose(std::int64_t id, const Ref& i, const Ref& j, const Pose& i_from_j,
                                const Information6& information, v1::ConstraintKind kind) {
    v1::IngestRequest item;
    auto& pose = *item.mutable_relative_pose();
    pose.set_id(id);
    *pose.mutable_keyframe_i() = keyframe_ref(i);
    *pose.mutable_keyframe_j() = keyframe_ref(j);
    *pose.mutable_keyframe_i_from_keyframe_j() = i_from_j.message();
    pack(information, *pose.mutable_information());
    pose.set_kind(kind);
    return item;
}

/// Whether a solve follows an item.
bool is_solved(const v1::IngestRequest& item) {
    switch (item.item_case()) {
        case v1::IngestRequest::kCamera:
        case v1::IngestRequest::kLandmarks: return false;
        case v1::IngestRequest::kRelativePose:
            return item.relative_pose().kind() == v1::CONSTRAINT_KIND_LOOP_CLOSURE;
        default: return true;
    }
}

/// The next id; the last one has none.
std::int64_t after(std::int64_t id) { return id == std::numeric_limits<std::int64_t>::max() ? id : id + 1; }

v1::Camera sized(std::int64_t id, int width_px, int height_px) {
    v1::Camera out;
    out.set_id(id);
    out.set_width_px(width_px);
    out.set_height_px(height_px);
    return out;
}

double at(const std::vector<double>& values, std::size_t index) {
    return index < values.size() ? values[index] : 0.0;
}

template <class Model>
void set_center(Model& model, double fx, double fy, double cx, double cy) {
    model.set_fx(fx);
    model.set_fy(fy);
    model.set_cx(cx);
    model.set_cy(cy);
}

}  // namespace

struct Session::State {
    std::shared_ptr<const detail::Link> link;
    std::string map_id;
    std::string client_id;
    RetryPolicy retry;
    detail::Stream stream;
    /// Held while an item is made and handed over: items are numbered in the order of the calls.
    std::mutex sending;
    std::set<std::int64_t> cameras;
    /// One more than the highest id in the map or sent.
    std::int64_t next_keyframe_id = 0;
    std::int64_t next_landmark_id = 0;

    State(std::shared_ptr<const detail::Link> to, const std::string& map, const std::string& client,
          SessionOptions options)
        : link(std::move(to)), map_id(map), client_id(client), retry(options.retry),
          stream(link, map, client, std::move(options)) {}

    std::int64_t camera_of(const Keyframe& keyframe) const {
        if (keyframe.camera) {
            return *keyframe.camera;
        }
        if (cameras.size() == 1) {
            return *cameras.begin();
        }
        throw Error(ErrorKind::kArgument,
                    cameras.empty() ? "the session has no camera: call camera(), or say which one the map has"
                                    : "the session has several cameras: say which one the keyframe is of");
    }

    /// Sends an item. `sending` is held.
    std::int64_t send(v1::IngestRequest item, std::optional<std::int64_t> number = {}) {
        std::vector<std::int64_t> named;
        const auto& added = item.has_keyframe() ? item.keyframe().landmarks() : item.landmarks().landmarks();
        for (const auto& landmark : added) {
            named.push_back(landmark.id());
        }
        if (item.has_keyframe()) {
            next_keyframe_id = std::max(next_keyframe_id, after(item.keyframe().id()));
        }
        for (const std::int64_t id : named) {
            next_landmark_id = std::max(next_landmark_id, after(id));
        }
        std::vector<std::int64_t> gone;
        const auto is_own = [this](const v1::LandmarkRef& ref) {
            return ref.client_id().empty() || ref.client_id() == client_id;
        };
        const auto& removed = item.has_fuse_landmarks() ? item.fuse_landmarks().absorbed()
                                                        : item.remove_landmarks().landmarks();
        for (const auto& ref : removed) {
            if (is_own(ref)) {
                gone.push_back(ref.id());
            }
        }
        const bool has_camera = item.has_camera();
        const std::int64_t camera = item.camera().id();
        const bool is_waited_for = is_solved(item);
        const auto sequence = stream.send(std::move(item), is_waited_for, stream.unknown(named), number);
        if (has_camera) {
            cameras.insert(camera);
        }
        stream.forget(gone);
        return sequence;
    }
};

Session::Session(std::unique_ptr<State> state) : state_(std::move(state)) {}
Session::Session(Session&&) noexcept = default;
Session& Session::operator=(Session&&) noexcept = default;
Session::~Session() = default;

Session Session::open(std::shared_ptr<const detail::Link> link, const std::string& map_id,
                      const std::string& client_id, SessionOptions options) {
    Session session(std::make_unique<State>(link, map_id, client_id, std::move(options)));
    auto& stream = session.state_->stream;
    stream.open();
    session.state_->next_keyframe_id = stream.first().next_keyframe_id();
    session.state_->next_landmark_id = stream.first().next_landmark_id();
    if (stream.first().next_sequence() > 1) {
        // An earlier session of this client may have sent landmarks: they are not declared again.
        v1::ListLandmarksRequest request;
        request.set_map_id(map_id);
        request.mutable_read_mask()->add_paths("id");
        link->answers(
            &v1::MapService::Stub::ListLandmarks, request, {}, [&](const v1::ListLandmarksResponse& page) {
                std::vector<std::int64_t> ids;
                for (const auto& landmark : page.landmarks()) {
                    if (landmark.client_id() == client_id) {
                        ids.push_back(landmark.id());
                    }
                }
                stream.know(ids);
            });
    }
    return session;
}

const v1::IngestOpened& Session::opened() const { return state_->stream.first(); }
std::int64_t Session::next_sequence() const { return state_->stream.next_sequence(); }
std::int64_t Session::next_keyframe_id() const {
    const std::lock_guard<std::mutex> lock(state_->sending);
    return state_->next_keyframe_id;
}
std::int64_t Session::next_landmark_id() const {
    const std::lock_guard<std::mutex> lock(state_->sending);
    return state_->next_landmark_id;
}
IngestReport Session::report() const { return state_->stream.report(); }

std::int64_t Session::camera(const v1::Camera& camera) {
    v1::IngestRequest item;
    *item.mutable_camera() = camera;
    return send(std::move(item));
}

std::int64_t Session::keyframe(const Keyframe& keyframe) {
    const std::lock_guard<std::mutex> lock(state_->sending);
    v1::IngestRequest item;
    auto& out = *item.mutable_keyframe();
    out.set_id(keyframe.id);
    // Rounds down, so that nanos are not negative before 1970 either.
    const std::int64_t since = keyframe.capture_time.count();
    const std::int64_t nanos = (since % kNanosPerSecond + kNanosPerSecond) % kNanosPerSecond;
    out.mutable_capture_time()->set_seconds((since - nanos) / kNanosPerSecond);
    out.mutable_capture_time()->set_nanos(static_cast<std::int32_t>(nanos));
    if (keyframe.camera || !keyframe.observations.empty() || state_->cameras.size() == 1) {
        out.set_camera_id(state_->camera_of(keyframe));
    }
    *out.mutable_world_from_camera() = keyframe.world_from_camera.message();
    if (keyframe.odom_from_camera) {
        *out.mutable_odom_from_camera() = keyframe.odom_from_camera->message();
    }
    std::vector<std::int64_t> seen;
    out.mutable_observations()->Reserve(static_cast<int>(keyframe.observations.size()));
    for (const auto& observation : keyframe.observations) {
        write(observation, keyframe.descriptor_kind, keyframe.descriptor_name, *out.add_observations());
        seen.push_back(observation.landmark);
    }
    for (const std::int64_t id : state_->stream.unknown(seen)) {
        auto& landmark = *out.add_landmarks();
        landmark.set_id(id);
        const auto first = static_cast<std::size_t>(std::find(seen.begin(), seen.end(), id) - seen.begin());
        if (const auto& point = keyframe.observations[first].new_point) {
            *landmark.mutable_point_in_world() = vector3(*point);
        }
    }
    return state_->send(std::move(item));
}

std::int64_t Session::observations(const Ref& keyframe, const std::vector<Observation>& observations,
                                   v1::DescriptorKind descriptor_kind,
                                   const std::string& descriptor_name) {
    v1::IngestRequest item;
    auto& out = *item.mutable_observations();
    *out.mutable_keyframe() = keyframe_ref(keyframe);
    for (const auto& observation : observations) {
        write(observation, descriptor_kind, descriptor_name, *out.add_observations());
    }
    return send(std::move(item));
}

std::int64_t Session::landmarks(const std::vector<std::int64_t>& ids,
                                const std::vector<std::optional<Vector3>>& points) {
    if (!points.empty() && points.size() != ids.size()) {
        throw Error(ErrorKind::kArgument, "points must be one a landmark, " + std::to_string(ids.size()) +
                                              ", not " + std::to_string(points.size()));
    }
    v1::IngestRequest item;
    for (std::size_t index = 0; index < ids.size(); ++index) {
        auto& landmark = *item.mutable_landmarks()->add_landmarks();
        landmark.set_id(ids[index]);
        if (!points.empty() && points[index]) {
            *landmark.mutable_point_in_world() = vector3(*points[index]);
        }
    }
    return send(std::move(item));
}

std::int64_t Session::closure(std::int64_t id, const Ref& keyframe_i, const Ref& keyframe_j,
                              const Pose& i_from_j, const Information6& information) {
    return send(relative_pose(id, keyframe_i, keyframe_j, i_from_j, information,
                              v1::CONSTRAINT_KIND_LOOP_CLOSURE));
}

std::int64_t Session::odometry(std::int64_t id, const Ref& keyframe_i, const Ref& keyframe_j,
                               const Pose& i_from_j, const Information6& information) {
    return send(relative_pose(id, keyframe_i, keyframe_j, i_from_j, information,
                              v1::CONSTRAINT_KIND_ODOMETRY));
}

std::int64_t Session::position_prior(std::int64_t id, const Ref& keyframe, const Vector3& point_in_world,
                                     const Information3& information, const Vector3& point_in_camera) {
    v1::IngestRequest item;
    auto& out = *item.mutable_position_prior();
    out.set_id(id);
    *out.mutable_keyframe() = keyframe_ref(keyframe);
    *out.mutable_point_in_world() = vector3(point_in_world);
    *out.mutable_point_in_camera() = vector3(point_in_camera);
    pack(information, *out.mutable_information());
    return send(std::move(item));
}

std::int64_t Session::pose_prior(std::int64_t id, const Ref& keyframe, const Pose& world_from_camera,
                                 const Information6& information) {
    v1::IngestRequest item;
    auto& out = *item.mutable_pose_prior();
    out.set_id(id);
    *out.mutable_keyframe() = keyframe_ref(keyframe);
    *out.mutable_world_from_camera() = world_from_camera.message();
    pack(information, *out.mutable_information());
    return send(std::move(item));
}

std::int64_t Session::send(v1::IngestRequest item, std::optional<std::int64_t> sequence) {
    const std::lock_guard<std::mutex> lock(state_->sending);
    return state_->send(std::move(item), sequence);
}

std::vector<v1::IngestRequest> Session::unanswered() const { return state_->stream.unanswered(); }

void Session::flush(Timeout timeout) {
    state_->stream.wait(detail::By::kAnswer, {}, timeout, false, "no answers");
}

void Session::wait_durable(std::optional<std::int64_t> sequence, Timeout timeout) {
    state_->stream.wait(detail::By::kDurable, sequence, timeout, true, "not durable");
}

void Session::wait_optimized(std::optional<std::int64_t> sequence, Timeout timeout) {
    state_->stream.wait(detail::By::kOptimized, sequence, timeout, true, "not optimized");
}

void Session::wait_settled(Timeout timeout) {
    const auto begin = detail::Clock::now();
    flush(timeout);
    if (timeout) {
        const auto took = std::chrono::duration_cast<std::chrono::milliseconds>(detail::Clock::now() - begin);
        timeout = std::max(*timeout - took, std::chrono::milliseconds(0));
    }
    detail::wait_settled(*state_->link->apart(), state_->map_id, timeout, state_->retry);
}

IngestReport Session::finish(Timeout timeout) {
    state_->stream.finish(timeout);
    return state_->stream.report();
}

void Session::abort() noexcept { state_->stream.abort(); }

v1::Camera pinhole(std::int64_t id, int width_px, int height_px, double fx, double fy, double cx,
                   double cy, const std::vector<double>& distortion) {
    if (!distortion.empty() && distortion.size() != 4 && distortion.size() != 5) {
        throw Error(ErrorKind::kArgument, "distortion of a pinhole has 4 or 5 coefficients "
                                          "(k1, k2, p1, p2, k3), not " +
                                              std::to_string(distortion.size()));
    }
    v1::Camera out = sized(id, width_px, height_px);
    auto& model = *out.mutable_pinhole_radial_tangential();
    set_center(model, fx, fy, cx, cy);
    model.set_k1(at(distortion, 0));
    model.set_k2(at(distortion, 1));
    model.set_p1(at(distortion, 2));
    model.set_p2(at(distortion, 3));
    model.set_k3(at(distortion, 4));
    return out;
}

v1::Camera fisheye(std::int64_t id, int width_px, int height_px, double fx, double fy, double cx,
                   double cy, const std::vector<double>& distortion) {
    if (!distortion.empty() && distortion.size() != 4) {
        throw Error(ErrorKind::kArgument, "distortion of a fisheye has 4 coefficients, not " +
                                              std::to_string(distortion.size()));
    }
    v1::Camera out = sized(id, width_px, height_px);
    auto& model = *out.mutable_kannala_brandt();
    set_center(model, fx, fy, cx, cy);
    model.set_k1(at(distortion, 0));
    model.set_k2(at(distortion, 1));
    model.set_k3(at(distortion, 2));
    model.set_k4(at(distortion, 3));
    return out;
}

}  // namespace covis
