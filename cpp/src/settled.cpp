//! Two calls over one link, and again over the next.

#include "settled.hpp"

#include <algorithm>
#include <thread>

#include "covis/v1/map_service.grpc.pb.h"
#include "retry.hpp"
#include "stream.hpp"

namespace covis::detail {
namespace {

using Time = std::chrono::system_clock::time_point;

/// Whether nothing is pending, of a map or a delta; `error` says where that is not known or does not come.
template <class Told>
bool is_settled(const std::string& map_id, const Told& told, std::optional<Error>& error) {
    if (!told.has_pending_work()) {
        error.emplace(ErrorKind::kProtocol, "WatchMap: the server does not say what is pending");
        return false;
    }
    const auto& pending = told.pending_work();
    if (pending.unoptimized_item_count() == 0 && pending.place_search_count() == 0 &&
        !pending.closure_adjustment() && !pending.optimization()) {
        return true;
    }
    const bool is_frozen = told.state() == v1::MAP_STATE_FROZEN;
    if (is_frozen || told.state() == v1::MAP_STATE_POISONED) {
        error.emplace(ErrorKind::kMapNotOpen, "map " + map_id + " is " + (is_frozen ? "frozen" : "poisoned") +
                                                  ": its remaining work waits until it is open");
    }
    return false;
}

/// Waits over one link; why that ended, nothing where the map is settled.
std::optional<Error> settled(const Link& link, const std::string& map_id, const std::optional<Time>& until,
                             Retries& retries) {
    std::optional<Error> error;
    v1::MapService::Stub stub(link.channel());
    grpc::ClientContext asking;
    link.prepare(asking);
    const Time deadline = std::chrono::system_clock::now() + link.deadline();
    asking.set_deadline(until ? std::min(*until, deadline) : deadline);
    v1::GetMapRequest wanted;
    wanted.set_map_id(map_id);
    v1::GetMapResponse found;
    const auto status = stub.GetMap(&asking, wanted, &found);
    if (!status.ok()) {
        return Error::of_call("GetMap", status);
    }
    if (is_settled(map_id, found.map(), error) || error) {
        return error;
    }
    v1::WatchMapRequest request;
    request.set_map_id(map_id);
    request.set_from_revision(found.map().revision());
    request.set_map_uid(found.map().uid());
    request.set_omit_landmarks(true);
    request.set_omit_constraints(true);
    grpc::ClientContext watching;
    link.prepare(watching);
    if (until) {
        watching.set_deadline(*until);
    }
    const auto reader = stub.WatchMap(&watching, request);
    v1::WatchMapResponse answer;
    bool is_done = false;
    while (!is_done && !error && reader->Read(&answer)) {
        retries.progress();
        is_done = answer.delta().last_part() && is_settled(map_id, answer.delta(), error);
    }
    if (is_done || error) {
        watching.TryCancel();
        reader->Finish();
        return error;
    }
    // Watching ends with a status; an end without one is a link that went away.
    const auto ended = reader->Finish();
    return ended.ok() ? broken("WatchMap", "the stream ended") : Error::of_call("WatchMap", ended);
}

}  // namespace

void wait_settled(const Link& link, const std::string& map_id, Timeout timeout, const RetryPolicy& policy) {
    std::optional<Time> until;
    if (timeout) {
        until = std::chrono::system_clock::now() + *timeout;
    }
    Retries retries(policy);
    while (const auto error = settled(link, map_id, until, retries)) {
        link.follow(*error);
        const bool is_late = until && std::chrono::system_clock::now() >= *until;
        if (is_late) {
            throw Error(ErrorKind::kTimeout, "not settled within " + std::to_string(timeout->count()) + " ms");
        }
        const auto next = retries.next(*error, Clock::now());
        if (const auto* last = std::get_if<Error>(&next)) {
            throw Error(*last);
        }
        std::this_thread::sleep_for(std::get<std::chrono::nanoseconds>(next));
    }
}

}  // namespace covis::detail
