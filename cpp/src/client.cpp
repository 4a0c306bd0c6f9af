//! Calls of a client. Those with one answer that solve nothing have a deadline.

#include "covis/client.hpp"

#include <algorithm>

#include "link.hpp"

namespace covis {

Client::Client(std::shared_ptr<const detail::Link> link) : link_(std::move(link)) {}

Client Client::connect(const std::string& url, const ConnectOptions& options) {
    auto link = std::make_shared<const detail::Link>(url, options);
    link->check();
    return Client(std::move(link));
}

std::string Client::url() const { return link_->url(); }
std::shared_ptr<grpc::Channel> Client::channel() const { return link_->channel(); }

bool Client::follows(const Error& error, int followed) const {
    return link_->follow(error) && followed < detail::kMostFollowed;
}

void Client::prepare(grpc::ClientContext& context, Timeout timeout) const {
    link_->prepare(context);
    if (timeout) {
        context.set_deadline(std::chrono::system_clock::now() + *timeout);
    }
}

void Client::create_if_missing(const std::string& map_id, const std::optional<v1::MapPolicy>& policy) const {
    try {
        get_map(map_id);
        return;
    } catch (const Error& error) {
        if (error.code() != grpc::StatusCode::NOT_FOUND) {
            throw;
        }
    }
    try {
        create_map(map_id, policy);
    } catch (const Error& error) {
        // Another client was quicker.
        if (error.code() != grpc::StatusCode::ALREADY_EXISTS) {
            throw;
        }
    }
}

Session Client::ingest(const std::string& map_id, const std::string& client_id, SessionOptions options) {
    if (options.create) {
        create_if_missing(map_id, options.policy);
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

}  // namespace covis
