//! An ingest session: what a frontend holds to send items, whatever happens to the link.
//!
//! Sending numbers an item, keeps it until the server has answered it and waits while too many are
//! unanswered: that is the back-pressure. A thread of the session moves the items.

#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "covis/options.hpp"
#include "covis/pose.hpp"
#include "covis/v1/ingest_service.pb.h"

namespace covis {

namespace detail {
class Link;
}  // namespace detail

/// A landmark seen at a pixel.
struct Observation {
    /// One's own landmark. One not seen before is declared.
    std::int64_t landmark = 0;
    /// (column, row), px, an integer at a pixel's center.
    double u = 0.0;
    double v = 0.0;
    /// Standard deviation of the pixel's coordinates, px.
    std::optional<double> sigma_px;
    /// z in the camera's frame, m.
    std::optional<double> depth_m;
    /// Its standard deviation, m. By default `kinect_sigma_m`.
    std::optional<double> sigma_depth_m;
    /// The landmark's start value if it is declared, world frame, m. Without it the server places the
    /// landmark by its depth or by triangulation.
    std::optional<Vector3> new_point;
    /// What the feature looks like; see `v1::Descriptor`.
    std::string descriptor;
};

/// A posed image with what it sees.
struct Keyframe {
    /// At least 0, unique among the client's keyframes.
    std::int64_t id = 0;
    /// Middle of the exposure, since the beginning of 1970.
    std::chrono::nanoseconds capture_time{0};
    /// The start estimate.
    Pose world_from_camera;
    /// The pose in the client's own frame, which never jumps; by default `world_from_camera`.
    std::optional<Pose> odom_from_camera;
    /// The only camera by default.
    std::optional<std::int64_t> camera;
    std::vector<Observation> observations;
    /// How descriptors are compared, and what made them: only those of one name are compared.
    v1::DescriptorKind descriptor_kind = v1::DESCRIPTOR_KIND_BINARY;
    std::string descriptor_name;
};

/// An open session of one client on one map, from `Client::ingest`. Its calls may come from several
/// threads. Destroying it ends it at once, as `abort` does: call `finish` before.
class Session {
  public:
    Session(Session&&) noexcept;
    Session& operator=(Session&&) noexcept;
    ~Session();

    /// The server's answer to the first opening: limits, durability, where it goes on.
    const v1::IngestOpened& opened() const;
    /// The sequence that the next item gets.
    std::int64_t next_sequence() const;
    /// A keyframe id that is free: above those of this client's keyframes that the map holds and that this
    /// session has sent. A frontend that starts again under its name counts on from here.
    std::int64_t next_keyframe_id() const;
    /// As `next_keyframe_id`, for landmarks.
    std::int64_t next_landmark_id() const;
    /// How far the session has come.
    IngestReport report() const;

    /// Adds a camera, for instance from `pinhole`, and returns the item's sequence. An earlier session
    /// of the client may have sent the same camera.
    std::int64_t camera(const v1::Camera& camera);
    /// Adds a keyframe with what it sees, and returns the item's sequence.
    std::int64_t keyframe(const Keyframe& keyframe);
    /// Adds observations to a keyframe that was sent before. The landmarks must be known to the map.
    std::int64_t observations(const Ref& keyframe, const std::vector<Observation>& observations,
                              v1::DescriptorKind descriptor_kind = v1::DESCRIPTOR_KIND_BINARY,
                              const std::string& descriptor_name = "");
    /// Adds landmarks, with their positions in the world frame (m) where they are known.
    std::int64_t landmarks(const std::vector<std::int64_t>& ids,
                           const std::vector<std::optional<Vector3>>& points = {});
    /// Adds a loop closure: the measured pose of keyframe j in the frame of keyframe i.
    std::int64_t closure(std::int64_t id, const Ref& keyframe_i, const Ref& keyframe_j,
                         const Pose& i_from_j, const Information6& information);
    /// Adds a relative pose that tracking or wheels measured.
    std::int64_t odometry(std::int64_t id, const Ref& keyframe_i, const Ref& keyframe_j,
                          const Pose& i_from_j, const Information6& information);
    /// Adds a measured position (GNSS, motion capture) of a point of the keyframe, m.
    std::int64_t position_prior(std::int64_t id, const Ref& keyframe, const Vector3& point_in_world,
                                const Information3& information,
                                const Vector3& point_in_camera = {0.0, 0.0, 0.0});
    /// Adds a measured pose.
    std::int64_t pose_prior(std::int64_t id, const Ref& keyframe, const Pose& world_from_camera,
                            const Information6& information);
    /// Sends any item of the wire, an edit for instance. Its sequence is the next one, or a given one that
    /// is above all before on this session: one below `next_sequence` of a fresh session sends an item
    /// again that an earlier session may have sent, and the server compares the two.
    std::int64_t send(v1::IngestRequest item, std::optional<std::int64_t> sequence = {});
    /// The items that the server may not have, by sequence: those without an answer, and on a durable
    /// server those that are not on its disk yet. They stay when the session has ended; another one sends
    /// them by `send(item, item.sequence())`, which is harmless where the server has them.
    std::vector<v1::IngestRequest> unanswered() const;

    /// Waits until every item sent so far is answered.
    void flush(Timeout timeout = {});
    /// Waits until the item, by default everything sent so far, is on the server's disk. Throws
    /// `kRejected` where the item was refused, by default where any was of which nobody was told yet;
    /// `kNotDurable`; `kTimeout`; why the session ended.
    void wait_durable(std::optional<std::int64_t> sequence = {}, Timeout timeout = {});
    /// Waits until solves have covered the item and those before it, by default all sent so far. Items
    /// that no solve follows (cameras, landmarks, odometry) do not wait. Throws as `wait_durable` does.
    void wait_optimized(std::optional<std::int64_t> sequence = {}, Timeout timeout = {});
    /// Waits until everything sent so far is answered and the map is settled: see
    /// `Client::wait_settled`.
    void wait_settled(Timeout timeout = {});
    /// Half-closes the stream, waits for all acks, those of pending solves too, and reports. Throws
    /// `kRejected` where items were refused of which nobody was told yet, else why the session ended
    /// before that. After `kTimeout` the session still ends by itself.
    IngestReport finish(Timeout timeout = {});
    /// Ends the session at once. What was not answered may be missing on the server.
    void abort() noexcept;

  private:
    friend class Client;
    struct State;

    explicit Session(std::unique_ptr<State> state);
    static Session open(std::shared_ptr<const detail::Link> link, const std::string& map_id,
                        const std::string& client_id, SessionOptions options);

    std::unique_ptr<State> state_;
};

/// A pinhole camera with OpenCV's coefficients: (k1, k2, p1, p2[, k3]) or none.
v1::Camera pinhole(std::int64_t id, int width_px, int height_px, double fx, double fy, double cx,
                   double cy, const std::vector<double>& distortion = {});

/// A camera of OpenCV's fisheye model: (k1, k2, k3, k4) or none.
v1::Camera fisheye(std::int64_t id, int width_px, int height_px, double fx, double fy, double cx,
                   double cy, const std::vector<double>& distortion = {});

}  // namespace covis
