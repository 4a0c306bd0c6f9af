//! The thread behind a session: one stream after the other until every item is answered.
//!
//! On each stream: open with an epoch above the last one, send what is unanswered, then what comes, and
//! take acks. A stream that breaks is followed by the next (`retry.hpp`); a fenced one, a replaced map
//! or a server that lost what it had acknowledged ends the session with the reason. One mutex guards
//! all state; it is not held while gRPC or a callback runs. Nothing is thrown on the threads of a
//! stream: what fails there is a value.

#pragma once

#include <condition_variable>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <thread>
#include <unordered_set>

#include <grpcpp/grpcpp.h>

#include "covis/v1/ingest_service.grpc.pb.h"
#include "link.hpp"
#include "outbox.hpp"
#include "retry.hpp"

namespace covis::detail {

/// Which acks an item waits for.
enum class By { kAnswer, kDurable, kOptimized };

/// The items of a session on their way.
class Stream {
  public:
    Stream(std::shared_ptr<const Link> link, std::string map_id, std::string client_id,
           SessionOptions options);
    ~Stream() { abort(); }
    Stream(const Stream&) = delete;
    Stream& operator=(const Stream&) = delete;

    /// Begins the first stream; throws why it does not come to stand.
    void open();
    /// The answer to the first opening, which does not change.
    const v1::IngestOpened& first() const { return first_; }
    /// Whether DURABLE never comes.
    bool is_in_memory() const { return first_.durability() == v1::DURABILITY_IN_MEMORY; }
    std::int64_t next_sequence() const;
    IngestReport report() const;
    /// The items that the server may not have, by sequence.
    std::vector<v1::IngestRequest> unanswered() const;

    /// Landmarks that the map has, or will have from items that are on their way.
    void know(const std::vector<std::int64_t>& landmarks);
    void forget(const std::vector<std::int64_t>& landmarks);
    /// Those of `landmarks` that are not known, each once, in order.
    std::vector<std::int64_t> unknown(const std::vector<std::int64_t>& landmarks) const;

    /// Numbers an item, by default as the next one, waits until there is room and hands it over.
    /// `declared` are landmarks that it makes known. Only one thread may send at a time.
    std::int64_t send(v1::IngestRequest item, bool is_solved, std::vector<std::int64_t> declared,
                      std::optional<std::int64_t> number);
    /// Waits until nothing up to `sequence` (by default all that was sent) waits for the ack, and
    /// throws `kRejected` where that item, or one that nobody was told of, was refused.
    void wait(By by, std::optional<std::int64_t> sequence, Timeout timeout, bool tells_refusals,
              const char* what);
    /// Half-closes, and waits until everything is answered.
    void finish(Timeout timeout);
    /// Ends it at once. What was not answered may be missing on the server.
    void abort() noexcept;

  private:
    using Lock = std::unique_lock<std::mutex>;
    using Call = grpc::ClientReaderWriter<v1::IngestRequest, v1::IngestResponse>;

    void run() noexcept;
    std::optional<Error> run_streams();
    std::optional<Error> stream();
    v1::IngestRequest opening();
    std::optional<Error> opened(const v1::IngestResponse& answer);
    std::optional<Error> exchange(Call& call, grpc::ClientContext& context);
    void send_all(Call& call, const bool& is_over);
    std::optional<Error> take(const v1::IngestAck& ack);
    void count(const v1::IngestAck& ack);
    void reject(const RejectedItem& item);
    std::optional<Error> check_resumed(const v1::IngestOpened& opened) const;
    Error explain(Error error);
    std::optional<Error> server_instance(std::string& instance_id);
    std::shared_ptr<grpc::ClientContext> begin_call();

    bool waits(By by, std::int64_t through) const;
    void check_open() const;
    void throw_untold();
    template <class Met>
    void until(Lock& lock, Timeout timeout, const char* what, Met met);

    const std::shared_ptr<const Link> link_;
    const std::string map_id_;
    const std::string client_id_;
    const SessionOptions options_;

    mutable std::mutex mutex_;
    std::condition_variable changed_;
    std::thread runner_;
    /// The call that is under way, to be canceled.
    std::shared_ptr<grpc::ClientContext> call_;
    Retries retries_;
    Outbox outbox_;
    std::optional<std::string> instance_id_;
    v1::IngestOpened first_;
    bool is_opened_ = false;
    std::int64_t epoch_ = 0;
    std::int64_t last_sequence_ = 0;
    bool is_closing_ = false;
    bool is_aborted_ = false;
    bool is_done_ = false;
    std::optional<Error> failure_;
    IngestReport report_;
    std::map<By, std::set<std::int64_t>> waiting_;
    std::set<std::int64_t> refused_;
    /// Refused items of which nobody was told yet.
    std::vector<RejectedItem> untold_;
    std::unordered_set<std::int64_t> landmarks_;
    std::map<std::int64_t, std::vector<std::int64_t>> declared_;
};

/// Calls a callback of the program. An exception of it becomes a value.
template <class Argument>
std::optional<Error> call_back(const std::function<void(const Argument&)>& callback,
                               const Argument& argument) {
    try {
        callback(argument);
        return std::nullopt;
    } catch (const std::exception& error) {
        return Error(ErrorKind::kCallback, std::string("a callback failed: ") + error.what());
    } catch (...) {
        return Error(ErrorKind::kCallback, "a callback failed");
    }
}

/// A link that went away without a status.
inline Error broken(const char* rpc, const char* text) {
    return Error::of_call(rpc, grpc::Status(grpc::StatusCode::UNAVAILABLE, text));
}

}  // namespace covis::detail
