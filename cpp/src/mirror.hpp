//! A copy of a map on the client's side, which deltas keep up to date.
//!
//! Entities come whole, so applying a delta is overwriting; a reset drops all there was. The parts of a
//! delta are applied together or not at all (docs/wire.md, "Watching a map"). No thread, no lock here.

#pragma once

#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "covis/map.hpp"

namespace covis::detail {

/// The map as of one revision.
struct Mirror {
    /// The map's uid; empty before the first delta.
    std::string uid;
    std::int64_t revision = 0;
    v1::MapState state = v1::MAP_STATE_UNSPECIFIED;
    std::optional<v1::PendingWork> pending_work;
    /// Those that own something, or did since the last reset.
    std::set<std::string> clients;
    std::map<Ref, v1::Camera> cameras;
    std::map<Ref, std::chrono::nanoseconds> times;
    std::map<Ref, Pose> poses;
    std::map<Ref, std::optional<Vector3>> landmarks;
    std::map<Ref, v1::Constraint> constraints;
    std::map<std::string, Pose> frames;
    std::map<std::string, double> scales;

    /// Applies a whole delta, given as all its parts in order, and tells what it changed. Where the
    /// parts do not belong together or the delta starts from another revision, `error` says so and the
    /// mirror is unchanged.
    MapChanges apply(const std::vector<v1::MapDelta>& parts, std::optional<Error>& error);

  private:
    void apply_part(const v1::MapDelta& part, MapChanges& changes);
};

/// The loop closures among constraints, by owner and id.
std::vector<Closure> closures(const std::map<Ref, v1::Constraint>& constraints);

}  // namespace covis::detail
