//! A connection to a server, and its calls. A call with one answer is made again where it may be
//! repeated (`Error::may_repeat`); of others that is the caller's to know.

#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include <grpcpp/grpcpp.h>

#include "covis/map.hpp"
#include "covis/options.hpp"
#include "covis/session.hpp"
#include "covis/v1/map_service.grpc.pb.h"
#include "covis/v1/optimization_service.grpc.pb.h"
#include "covis/v1/server_service.grpc.pb.h"

namespace covis {

namespace detail {
/// What is known of the attempts of a call.
struct Attempts;
}  // namespace detail

/// A keyframe's pose and its time.
struct TimedPose {
    Ref keyframe;
    std::chrono::nanoseconds capture_time{0};
    Pose world_from_camera;
};

/// A connection to a server. Copies share it; sessions and watches keep it for themselves. A broken
/// connection is made again by the next call.
class Client {
  public:
    /// Connects to a server, for instance `https://maps.example:7411`, or of several that share maps,
    /// separated by commas, to the first that answers; calls, sessions and watches then follow to the
    /// server that has their map, and on to the next when a link breaks. A token is never sent in plain
    /// text to another machine. Throws `kInvalidUrl`, `kInvalidToken`, `kTokenInPlainText`,
    /// `kUnreachable`.
    static Client connect(const std::string& url, const ConnectOptions& options = {});

    /// The address that calls go to.
    std::string url() const;

    /// Opens a session that sends what `client_id` sees into a map. Throws `kRetriesExhausted`, and
    /// `kRpc` with NOT_FOUND, or FAILED_PRECONDITION for a frozen map.
    Session ingest(const std::string& map_id, const std::string& client_id, SessionOptions options = {});
    /// Follows a map; returns once its full state is there. Throws `kRpc` with NOT_FOUND,
    /// `kRetriesExhausted`.
    Map watch(const std::string& map_id, WatchOptions options = {});

    /// Version, limits, durability and features of the server.
    v1::GetServerInfoResponse server_info() const;
    /// Creates an empty map; without a policy it has the server's. Throws `kRpc` with ALREADY_EXISTS.
    v1::Map create_map(const std::string& map_id, const std::optional<v1::MapPolicy>& policy = {}) const;
    /// One map with its policy and counts. Throws `kRpc` with NOT_FOUND.
    v1::Map get_map(const std::string& map_id) const;
    /// Waits until a map is settled: the server does nothing more to it by itself. Solves have covered all
    /// items of all clients, no place is still to be searched, no adjustment after loop closures is due or
    /// runs, and no requested optimization runs. A map that others go on sending to may not settle for as
    /// long as they do. Throws `kRpc` with NOT_FOUND; `kMapNotOpen` where the map is frozen or poisoned
    /// and its work waits; `kTimeout`; `kRetriesExhausted`.
    void wait_settled(const std::string& map_id, Timeout timeout = {}, const RetryPolicy& retry = {}) const;
    /// Deletes a map with its journal. Throws `kRpc` with NOT_FOUND.
    void delete_map(const std::string& map_id) const;
    /// The poses of one client's keyframes by time; of all clients' by default.
    std::vector<TimedPose> trajectory(const std::string& map_id, const std::string& client_id = "") const;
    /// Optimizes a whole map; `on_iteration` gets each iteration as it comes.
    v1::OptimizeMapResult optimize(
        const v1::OptimizeMapRequest& request,
        const std::function<void(const v1::IterationSummary&)>& on_iteration = {}) const;
    /// Refines the pose of one camera over known points (motion-only), in milliseconds; no map is involved.
    /// Throws `kRpc` with INVALID_ARGUMENT.
    v1::RefinePoseResponse refine_pose(const v1::RefinePoseRequest& request) const;

    /// Makes any call of the wire with one answer, for instance
    /// `client.call(&v1::MapService::Stub::ListMaps, request)`. Throws `kRpc`.
    template <class Service, class Question, class Answer>
    Answer call(grpc::Status (Service::*method)(grpc::ClientContext*, const Question&, Answer*),
                const Question& request, Timeout timeout = {}) const {
        return call_with(method, request, timeout, nullptr);
    }

    /// The channel, for stubs of the program's own; `prepare` puts the token on a call.
    std::shared_ptr<grpc::Channel> channel() const;
    void prepare(grpc::ClientContext& context, Timeout timeout = {}) const;

  private:
    explicit Client(std::shared_ptr<const detail::Link> link);
    /// Makes a call; without a policy by the retries of the link.
    template <class Service, class Question, class Answer>
    Answer call_with(grpc::Status (Service::*method)(grpc::ClientContext*, const Question&, Answer*),
                     const Question& request, Timeout timeout, const RetryPolicy* retry) const {
        const auto attempts = begin(timeout, retry);
        while (true) {
            grpc::ClientContext context;
            prepare(context, *attempts);
            Service stub(channel());
            Answer answer;
            const grpc::Status status = (stub.*method)(&context, request, &answer);
            if (status.ok()) {
                return answer;
            }
            const Error error = Error::of_request(Question::descriptor()->name(), status);
            if (!repeats(error, *attempts)) {
                throw Error(error);
            }
        }
    }

    std::shared_ptr<detail::Attempts> begin(Timeout timeout, const RetryPolicy* retry) const;
    void prepare(grpc::ClientContext& context, const detail::Attempts& attempts) const;
    /// Whether the call is made again, at the server that the error names or after a wait.
    bool repeats(const Error& error, detail::Attempts& attempts) const;
    void create_if_missing(const std::string& map_id, const SessionOptions& options) const;

    std::shared_ptr<const detail::Link> link_;
};

}  // namespace covis
