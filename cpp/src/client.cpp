//! Calls of a client. Those with one answer that solve nothing have a deadline.

#include "covis/client.hpp"

#include <algorithm>
#include <thread>

#include "link.hpp"
#include "retry.hpp"
#include "settled.hpp"

namespace covis {

struct detail::Attempts {
    explicit Attempts(const RetryPolicy& policy) : retries(policy) {}

    Retries retries;
    int followed = 0;
    /// The deadline of all of them together.
    std::optional<std::chrono::system_clock::time_point> until;
};

Client::Client(std::shared_ptr<const detail::Link> link) : link_(std::move(link)) {}

Client Client::connect(const std::string& url, const ConnectOptions& options) {
    auto link = std::make_shared<const detail::Link>(url, options);
    link->check();
    return Client(std::move(link));
}

std::string Client::url() const { return link_->url(); }
std::shared_ptr<grpc::Channel> Client::channel() const { return link_->channel(); }

std::shared_ptr<detail::Attempts> Client::begin(Timeout timeout, const RetryPolicy* retry) const {
    RetryPolicy policy = retry != nullptr ? *retry : link_->retry();
    if (timeout) {
        policy.give_up_after = std::min(*timeout, policy.give_up_after.value_or(*timeout));
    }
    auto attempts = std::make_shared<detail::Attempts>(policy);
    if (timeout) {
        attempts->until = std::chrono::system_clock::now() + *timeout;
    }
    return attempts;
}

void Client::prepare(grpc::ClientContext& context, const detail::Attempts& attempts) const {
    link_->prepare(context);
    if (attempts.until) {
        context.set_deadline(*attempts.until);
    }
}

bool Client::repeats(const Error& error, detail::Attempts& attempts) const {
    if (link_->follow(error)) {
        return attempts.followed++ < detail::kMostFollowed;
    }
    if (!error.may_repeat()) {
        return false;
    }
    const auto next = attempts.retries.next(error, detail::Clock::now());
    const auto* wait = std::get_if<std::chrono::nanoseconds>(&next);
    if (wait == nullptr) {
        return false;
    }
    std::this_thread::sleep_for(*wait);
    return true;
}

void Client::prepare(grpc::ClientContext& context, Timeout timeout) const {
    link_->prepare(context);
    if (timeout) {
        context.set_deadline(std::chrono::system_clock::now() + *timeout);
    }
}

void Client::create_if_missing(const std::string& map_id, const SessionOptions& options) const {
    v1::GetMapRequest wanted;
    wanted.set_map_id(map_id);
    try {
        call_with(&v1::MapService::Stub::GetMap, wanted, link_->deadline(), &options.retry);
        return;
    } catch (const Error& error) {
        if (error.code() != grpc::StatusCode::NOT_FOUND) {
            throw;
        }
    }
    v1::CreateMapRequest request;
    request.set_map_id(map_id);
    if (options.policy) {
        *request.mutable_policy() = *options.policy;
    }
    try {
        call_with(&v1::MapService::Stub::CreateMap, request, link_->deadline(), &options.retry);
    } catch (const Error& error) {
        // Another client was quicker.
        if (error.code() != grpc::StatusCode::ALREADY_EXISTS) {
            throw;
        }
    }
}

Session Client::ingest(const std::string& map_id, const std::string& client_id, SessionOptions options) {
    if (options.create) {
        create_if_missing(map_id, options);
    }
    return Session::open(link_->apart(), map_id, client_id, std::move(options));
}

Map Client::watch(const std::string& map_id, WatchOptions options) {
    return Map::open(link_->apart(), map_id, std::move(options));
}

v1::GetServerInfoResponse Client::server_info() const {
    return call(&v1::ServerService::Stub::GetServerInfo, v1::GetServerInfoRequest(), link_->deadline());
}

v1::Map Client::create_map(const std::string& map_id, const std::optional<v1::MapPolicy>& policy) const {
    v1::CreateMapRequest request;
    request.set_map_id(map_id);
    if (policy) {
        *request.mutable_policy() = *policy;
    }
    return call(&v1::MapService::Stub::CreateMap, request, link_->deadline()).map();
}

v1::Map Client::get_map(const std::string& map_id) const {
    v1::GetMapRequest request;
    request.set_map_id(map_id);
    return call(&v1::MapService::Stub::GetMap, request, link_->deadline()).map();
}

void Client::wait_settled(const std::string& map_id, Timeout timeout, const RetryPolicy& retry) const {
    detail::wait_settled(*link_->apart(), map_id, timeout, retry);
}

void Client::delete_map(const std::string& map_id) const {
    v1::DeleteMapRequest request;
    request.set_map_id(map_id);
    call(&v1::MapService::Stub::DeleteMap, request, link_->deadline());
}

std::vector<TimedPose> Client::trajectory(const std::string& map_id, const std::string& client_id) const {
    v1::GetTrajectoryRequest request;
    request.set_map_id(map_id);
    request.set_client_id(client_id);
    std::vector<TimedPose> poses;
    link_->answers(&v1::MapService::Stub::GetTrajectory, request, {},
                   [&poses](const v1::GetTrajectoryResponse& part) {
                       for (const auto& pose : part.poses()) {
                           const auto& time = pose.capture_time();
                           poses.push_back({{pose.keyframe().client_id(), pose.keyframe().id()},
                                            std::chrono::seconds(time.seconds()) +
                                                std::chrono::nanoseconds(time.nanos()),
                                            Pose::from_message(pose.world_from_camera())});
                       }
                   });
    std::stable_sort(poses.begin(), poses.end(),
                     [](const auto& a, const auto& b) { return a.capture_time < b.capture_time; });
    return poses;
}

v1::OptimizeMapResult Client::optimize(
    const v1::OptimizeMapRequest& request,
    const std::function<void(const v1::IterationSummary&)>& on_iteration) const {
    std::optional<v1::OptimizeMapResult> result;
    link_->answers(&v1::OptimizationService::Stub::OptimizeMap, request, {},
                   [&](const v1::OptimizeMapResponse& event) {
                       if (event.has_result()) {
                           result = event.result();
                       } else if (event.has_iteration() && on_iteration) {
                           on_iteration(event.iteration());
                       }
                   });
    if (!result) {
        throw Error(ErrorKind::kProtocol, "OptimizeMap: the stream ended without a result");
    }
    return *result;
}

v1::RefinePoseResponse Client::refine_pose(const v1::RefinePoseRequest& request) const {
    return call(&v1::OptimizationService::Stub::RefinePose, request);
}

}  // namespace covis
