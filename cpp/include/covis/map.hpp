//! A live mirror of a map, which a thread keeps up to date over broken links.
//!
//! After a break the watch goes on from the revision it holds, naming the map's uid; the server answers
//! the missing deltas, or a reset where it no longer has them or the map is another one.

#pragma once

#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "covis/options.hpp"
#include "covis/pose.hpp"
#include "covis/v1/map_service.pb.h"

namespace covis {

namespace detail {
class Link;
}

/// A loop closure of a map.
struct Closure {
    Ref ref;
    Ref keyframe_i;
    Ref keyframe_j;
    /// The measured pose of keyframe j in the frame of keyframe i.
    Pose i_from_j;
    /// Whether it takes part in solves: false while it is switched off as false.
    bool counts = true;
    /// Switched off, and no other closure joins its two places.
    bool provisional = false;
    /// χ² at which it was switched off.
    std::optional<double> chi2;
};

/// A live mirror, from `Client::watch`. Entities are named by client and id, the client always.
/// Its calls may come from several threads; each property is one consistent copy.
class Map {
  public:
    Map(Map&&) noexcept;
    Map& operator=(Map&&) noexcept;
    /// Ends the watch.
    ~Map();

    /// The revision that the mirror holds.
    std::int64_t revision() const;
    /// Whether the map takes changes.
    v1::MapState state() const;
    /// What the server still did to the map by itself when it sent the last delta; nothing from an earlier
    /// server. See `Client::wait_settled`.
    std::optional<v1::PendingWork> pending_work() const;
    /// Those that own something in the map.
    std::set<std::string> clients() const;
    /// `world_from_camera` of each keyframe.
    std::map<Ref, Pose> poses() const;
    /// `world_from_camera` of one keyframe; nothing where the map has no such keyframe.
    std::optional<Pose> pose(const Ref& keyframe) const;
    /// Capture time of each keyframe, since the beginning of 1970.
    std::map<Ref, std::chrono::nanoseconds> times() const;
    /// Position of each landmark in the world frame, m; nothing where it has none yet.
    std::map<Ref, std::optional<Vector3>> landmarks() const;
    std::map<Ref, v1::Camera> cameras() const;
    /// Relative poses and priors, those that are switched off too.
    std::map<Ref, v1::Constraint> constraints() const;
    /// The loop closures, those that are switched off too.
    std::vector<Closure> closures() const;
    /// Where a client's odometry frame lies in the map; nothing while it has no keyframe. It is in the
    /// client's unit of length, in which the client makes its start estimates:
    /// `world_from_camera = map_from_odom * odom_from_camera`. See `scale`.
    std::optional<Pose> map_from_odom(const std::string& client_id) const;
    /// The length in the map of a client's unit of length: 1, unless its map was made without measured
    /// lengths and became part of another one. What a client sends is in its own unit; poses and
    /// landmarks here are in the map's, and it divides them by this.
    double scale(const std::string& client_id) const;

    /// Waits until the mirror holds `revision` (of an ack, say) or a later one.
    void wait(std::int64_t revision, Timeout timeout = {}) const;
    /// Waits until `is_met` is true; it is asked after each change, in the thread that calls. Throws
    /// why the watch ended (`kRpc` with NOT_FOUND when the map is deleted); `kTimeout`.
    void wait_until(const std::function<bool()>& is_met, Timeout timeout = {}) const;

  private:
    friend class Client;
    struct State;

    explicit Map(std::unique_ptr<State> state);
    static Map open(std::shared_ptr<const detail::Link> link, const std::string& map_id,
                    WatchOptions options);

    std::unique_ptr<State> state_;
};

}  // namespace covis
