//! Deltas into a mirror.

#include "mirror.hpp"

namespace covis::detail {
namespace {

template <class Message>
Ref ref_of(const Message& message) {
    return {message.client_id(), message.id()};
}

Vector3 vector3(const v1::Vector3& message) { return {message.x(), message.y(), message.z()}; }

}  // namespace

MapChanges Mirror::apply(const std::vector<v1::MapDelta>& parts, std::optional<Error>& error) {
    const auto refuse = [&error](const char* text) {
        error.emplace(ErrorKind::kProtocol, std::string("WatchMap: ") + text);
        return MapChanges{};
    };
    if (parts.empty()) {
        return refuse("a delta without parts");
    }
    const auto& first = parts.front();
    for (std::size_t index = 0; index < parts.size(); ++index) {
        const auto& part = parts[index];
        const bool is_last = index + 1 == parts.size();
        if (part.revision() != first.revision() || part.part_index() != static_cast<int>(index) ||
            part.last_part() != is_last) {
            return refuse("the parts of a delta do not belong together");
        }
    }
    if (!first.reset() && (first.base_revision() != revision || first.revision() < revision)) {
        return refuse("a delta does not start from the revision before it");
    }
    if (first.reset()) {
        *this = Mirror{};
    }
    MapChanges changes;
    changes.revision = first.revision();
    changes.reset = first.reset();
    for (const auto& part : parts) {
        apply_part(part, changes);
    }
    revision = first.revision();
    return changes;
}

void Mirror::apply_part(const v1::MapDelta& part, MapChanges& changes) {
    state = part.state();
    uid = part.map_uid();
    pending_work.reset();
    if (part.has_pending_work()) {
        pending_work = part.pending_work();
    }
    for (const auto& camera : part.cameras()) {
        cameras[ref_of(camera)] = camera;
        clients.insert(camera.client_id());
    }
    for (const auto& keyframe : part.keyframes()) {
        if (!keyframe.has_keyframe()) {
            continue;
        }
        const Ref ref = ref_of(keyframe.keyframe());
        poses[ref] = Pose::from_message(keyframe.world_from_camera());
        const auto& time = keyframe.capture_time();
        times[ref] = std::chrono::seconds(time.seconds()) + std::chrono::nanoseconds(time.nanos());
        clients.insert(ref.client_id);
        changes.keyframes.push_back(ref);
    }
    for (const auto& landmark : part.landmarks()) {
        const Ref ref = ref_of(landmark);
        std::optional<Vector3> point;
        if (landmark.has_point_in_world()) {
            point = vector3(landmark.point_in_world());
        }
        landmarks[ref] = point;
        clients.insert(ref.client_id);
        changes.landmarks.push_back(ref);
    }
    for (const auto& constraint : part.constraints()) {
        Ref ref;
        switch (constraint.constraint_case()) {
            case v1::Constraint::kRelativePose: ref = ref_of(constraint.relative_pose()); break;
            case v1::Constraint::kPositionPrior: ref = ref_of(constraint.position_prior()); break;
            case v1::Constraint::kPosePrior: ref = ref_of(constraint.pose_prior()); break;
            default: continue;  // A kind that this client does not know.
        }
        constraints[ref] = constraint;
        changes.constraints.push_back(ref);
    }
    for (const auto& frame : part.client_frames()) {
        if (frame.has_keyframe()) {
            frames[frame.client_id()] = Pose::from_message(frame.map_from_odom());
            // An earlier server sends none.
            scales[frame.client_id()] = frame.scale() > 0.0 ? frame.scale() : 1.0;
        } else {
            frames.erase(frame.client_id());
            scales.erase(frame.client_id());
        }
    }
    for (const auto& gone : part.removed_keyframes()) {
        poses.erase(ref_of(gone));
        times.erase(ref_of(gone));
        changes.keyframes.push_back(ref_of(gone));
    }
    for (const auto& gone : part.removed_landmarks()) {
        landmarks.erase(ref_of(gone));
        changes.landmarks.push_back(ref_of(gone));
    }
    for (const auto& gone : part.removed_constraints()) {
        constraints.erase(ref_of(gone));
        changes.constraints.push_back(ref_of(gone));
    }
}

std::vector<Closure> closures(const std::map<Ref, v1::Constraint>& constraints) {
    std::vector<Closure> found;
    for (const auto& [ref, constraint] : constraints) {
        const auto& measured = constraint.relative_pose();
        if (measured.kind() != v1::CONSTRAINT_KIND_LOOP_CLOSURE) {
            continue;
        }
        Closure closure;
        closure.ref = ref;
        closure.keyframe_i = ref_of(measured.keyframe_i());
        closure.keyframe_j = ref_of(measured.keyframe_j());
        closure.i_from_j = Pose::from_message(measured.keyframe_i_from_keyframe_j());
        if (measured.has_switched_off()) {
            closure.counts = false;
            closure.provisional = measured.switched_off().provisional();
            closure.chi2 = measured.switched_off().chi2();
        }
        found.push_back(closure);
    }
    return found;
}

}  // namespace covis::detail
