//! Errors from statuses. A status that the server built carries an `ErrorInfo` of domain "covis"; one
//! without comes from the transport, whose codes for a broken link vary (docs/wire.md, "Errors").
//! Whether a call may be repeated is decided here and nowhere else.

#include "covis/error.hpp"

#include "status.pb.h"

namespace covis {
namespace {

std::string describe(const Violation& violation) {
    return violation.field + ": " + violation.description + " (" + violation.reason + ")";
}

const char* name_of(grpc::StatusCode code) {
    switch (code) {
        case grpc::StatusCode::OK: return "OK";
        case grpc::StatusCode::CANCELLED: return "CANCELLED";
        case grpc::StatusCode::INVALID_ARGUMENT: return "INVALID_ARGUMENT";
        case grpc::StatusCode::DEADLINE_EXCEEDED: return "DEADLINE_EXCEEDED";
        case grpc::StatusCode::NOT_FOUND: return "NOT_FOUND";
        case grpc::StatusCode::ALREADY_EXISTS: return "ALREADY_EXISTS";
        case grpc::StatusCode::PERMISSION_DENIED: return "PERMISSION_DENIED";
        case grpc::StatusCode::UNAUTHENTICATED: return "UNAUTHENTICATED";
        case grpc::StatusCode::RESOURCE_EXHAUSTED: return "RESOURCE_EXHAUSTED";
        case grpc::StatusCode::FAILED_PRECONDITION: return "FAILED_PRECONDITION";
        case grpc::StatusCode::ABORTED: return "ABORTED";
        case grpc::StatusCode::OUT_OF_RANGE: return "OUT_OF_RANGE";
        case grpc::StatusCode::UNIMPLEMENTED: return "UNIMPLEMENTED";
        case grpc::StatusCode::INTERNAL: return "INTERNAL";
        case grpc::StatusCode::UNAVAILABLE: return "UNAVAILABLE";
        case grpc::StatusCode::DATA_LOSS: return "DATA_LOSS";
        default: return "UNKNOWN";
    }
}

/// The message of a detail if it is of the type; the type's URL ends in its name.
template <class Message>
bool unpack(const google::protobuf::Any& packed, const std::string& type, Message& into) {
    const std::string& url = packed.type_url();
    const std::string end = "/google.rpc." + type;
    const bool is_of_type =
        url.size() >= end.size() && url.compare(url.size() - end.size(), end.size(), end) == 0;
    return is_of_type && into.ParseFromString(packed.value());
}

}  // namespace

Error::Error(ErrorKind kind, const std::string& text)
    : Error(kind, text, std::make_shared<Details>()) {}

Error::Error(ErrorKind kind, const std::string& text, std::shared_ptr<const Details> details)
    : std::runtime_error(text), kind_(kind), details_(std::move(details)) {}

Error Error::of_call(const std::string& rpc, const grpc::Status& status) {
    auto details = std::make_shared<Details>();
    details->rpc = rpc;
    details->code = status.error_code();
    client::status::Status carried;
    if (carried.ParseFromString(status.error_details())) {
        for (const auto& packed : carried.details()) {
            client::status::ErrorInfo info;
            client::status::BadRequest refused;
            client::status::RetryInfo retry;
            if (unpack(packed, "ErrorInfo", info) && info.domain() == "covis") {
                details->reason = info.reason();
                details->metadata = {info.metadata().begin(), info.metadata().end()};
            } else if (unpack(packed, "BadRequest", refused)) {
                for (const auto& one : refused.field_violations()) {
                    details->violations.push_back({one.field(), one.description(), one.reason()});
                }
            } else if (unpack(packed, "RetryInfo", retry)) {
                const auto& delay = retry.retry_delay();
                details->retry_after =
                    std::chrono::seconds(delay.seconds()) + std::chrono::nanoseconds(delay.nanos());
            }
        }
    }
    std::string text = rpc + ": " + status.error_message();
    for (const auto& one : details->violations) {
        if (status.error_message().find(one.field) == std::string::npos) {
            text += "; " + describe(one);
        }
    }
    text += std::string(" (") + name_of(details->code) + ")";
    return Error(ErrorKind::kRpc, text, details);
}

Error Error::of_request(const std::string& request, const grpc::Status& status) {
    return of_call(request.substr(0, request.rfind("Request")), status);
}

Error Error::rejected(std::vector<RejectedItem> items) {
    auto details = std::make_shared<Details>();
    std::string text = "item " + std::to_string(items.front().sequence) + " was rejected: ";
    const char* separator = "";
    for (const auto& one : items.front().violations) {
        text += separator + describe(one);
        separator = "; ";
    }
    if (items.size() > 1) {
        text += " (and " + std::to_string(items.size() - 1) + " more)";
    }
    details->violations = items.front().violations;
    details->items = std::move(items);
    return Error(ErrorKind::kRejected, text, details);
}

Error Error::exhausted(int attempts, const Error& cause) {
    auto details = std::make_shared<Details>();
    details->attempts = attempts;
    details->cause = std::make_shared<const Error>(cause);
    const std::string text = "gave up after " + std::to_string(attempts) + " attempts: " + cause.what();
    return Error(ErrorKind::kRetriesExhausted, text, details);
}

const std::string* Error::owner() const noexcept {
    const auto found = details_->metadata.find("owner");
    const bool is_elsewhere = details_->reason == "MAP_OWNED_ELSEWHERE";
    return is_elsewhere && found != details_->metadata.end() ? &found->second : nullptr;
}

bool Error::may_repeat() const noexcept {
    if (kind_ != ErrorKind::kRpc || details_->code != grpc::StatusCode::UNAVAILABLE) {
        return false;
    }
    for (const char* reason : {"STARTING", "MAP_MOVING", "MAP_OWNED_ELSEWHERE"}) {
        if (details_->reason == reason) {
            return true;
        }
    }
    for (const char* start : {"Get", "List", "Localize", "RefinePose", "Solve", "CreateJob"}) {
        if (details_->rpc.rfind(start, 0) == 0) {
            return true;
        }
    }
    return false;
}

bool Error::is_transient() const noexcept {
    if (kind_ == ErrorKind::kUnreachable) {
        return true;
    }
    if (kind_ != ErrorKind::kRpc) {
        return false;
    }
    switch (details_->code) {
        case grpc::StatusCode::UNAVAILABLE: return true;
        case grpc::StatusCode::RESOURCE_EXHAUSTED: return !details_->reason.empty();
        case grpc::StatusCode::UNKNOWN:
        case grpc::StatusCode::INTERNAL:
        case grpc::StatusCode::CANCELLED: return details_->reason.empty();
        default: return false;
    }
}

}  // namespace covis
