//! What can go wrong between a program and its server. Errors are thrown in the thread that called;
//! threads of the library keep theirs as values until somebody asks.

#pragma once

#include <chrono>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include <grpcpp/support/status.h>

namespace covis {

/// A field that the server refuses.
struct Violation {
    /// Path from the request, for instance `keyframe.observations[3].pixel.x`.
    std::string field;
    /// For people.
    std::string description;
    /// For programs, for instance `NOT_FINITE`; see `ViolationReason` in docs/wire.md.
    std::string reason;
};

/// An item that the server refused for good.
struct RejectedItem {
    std::int64_t sequence = 0;
    std::vector<Violation> violations;
};

/// Why something failed.
enum class ErrorKind {
    /// An argument that does not fit; nothing was sent.
    kArgument,
    /// The server's address is no URL.
    kInvalidUrl,
    /// A token that is empty or does not fit a header. It is not shown.
    kInvalidToken,
    /// A token that others on the network could read; nothing was sent.
    kTokenInPlainText,
    /// No server answers at the address.
    kUnreachable,
    /// An answer that the wire does not allow.
    kProtocol,
    /// An item that the server would not take because of its size; nothing was sent.
    kTooLarge,
    /// The server refused items for good: `items`. The session goes on.
    kRejected,
    /// The server keeps its journal in memory: nothing becomes durable.
    kNotDurable,
    /// A newer stream of the same client took over.
    kFenced,
    /// The map was deleted and made again while the session was open.
    kMapReplaced,
    /// The server was started anew and no longer has the map: its journal was in memory.
    kServerRestarted,
    /// The server no longer has items that it had acknowledged.
    kItemsLost,
    /// A map that does not settle, because it takes no changes: its work waits.
    kMapNotOpen,
    /// The link did not come back within the retries: `attempts`, `cause`.
    kRetriesExhausted,
    /// The session or the watch has ended.
    kClosed,
    /// What was waited for did not come in time. The session goes on.
    kTimeout,
    /// A callback of the program threw an exception, which ended the session or watch.
    kCallback,
    /// The server, or the link to it, ended a call: `code`, `reason`, `violations`.
    kRpc,
};

/// Every error of this package.
class Error : public std::runtime_error {
  public:
    Error(ErrorKind kind, const std::string& text);

    /// The error that the call `rpc` ended with.
    static Error of_call(const std::string& rpc, const grpc::Status& status);
    /// The same by the name of the call's request, `CreateMapRequest` say.
    static Error of_request(const std::string& request, const grpc::Status& status);
    /// The server refused items; at least one.
    static Error rejected(std::vector<RejectedItem> items);
    /// The last of so many attempts failed.
    static Error exhausted(int attempts, const Error& cause);

    ErrorKind kind() const noexcept { return kind_; }
    /// The fields that the server refused, of the first item for `kRejected`; empty for other errors.
    const std::vector<Violation>& violations() const noexcept { return details_->violations; }
    /// The items that were refused: `kRejected`.
    const std::vector<RejectedItem>& items() const noexcept { return details_->items; }
    /// What a call ended with: `kRpc`.
    grpc::StatusCode code() const noexcept { return details_->code; }
    /// `ErrorInfo.reason` of a status that the server built, for instance `MAP_NOT_FOUND`, else empty.
    const std::string& reason() const noexcept { return details_->reason; }
    /// Values by name, for instance `map_id` and `limit`.
    const std::map<std::string, std::string>& metadata() const noexcept { return details_->metadata; }
    /// The URL of the server that has the map, where the one that was asked does not; null else.
    const std::string* owner() const noexcept;
    /// How long the server asks to wait before the next attempt.
    std::optional<std::chrono::nanoseconds> retry_after() const noexcept { return details_->retry_after; }
    /// How often it was tried: `kRetriesExhausted`.
    int attempts() const noexcept { return details_->attempts; }
    /// What the last attempt ended with: `kRetriesExhausted`, else null.
    const Error* cause() const noexcept { return details_->cause.get(); }
    /// Whether trying again may help: the link broke, or the server is full or shutting down.
    bool is_transient() const noexcept;
    /// Whether a call with one answer may be made again: the server or the link was not there
    /// (UNAVAILABLE), and the server says that it did nothing of the call, or the call changes nothing.
    bool may_repeat() const noexcept;

  private:
    struct Details {
        std::vector<Violation> violations;
        std::vector<RejectedItem> items;
        std::string rpc;
        grpc::StatusCode code = grpc::StatusCode::OK;
        std::string reason;
        std::map<std::string, std::string> metadata;
        std::optional<std::chrono::nanoseconds> retry_after;
        int attempts = 0;
        std::shared_ptr<const Error> cause;
    };

    Error(ErrorKind kind, const std::string& text, std::shared_ptr<const Details> details);

    ErrorKind kind_;
    std::shared_ptr<const Details> details_;
};

}  // namespace covis
