//! The threads of a session: streams, and the acks that come on them. `stream_calls.cpp` is the side of
//! the program.

#include "stream.hpp"

#include <algorithm>

#include "covis/v1/server_service.grpc.pb.h"

namespace covis::detail {
namespace {

constexpr const char* kRpc = "Ingest";

RejectedItem rejected_item(const v1::IngestAck& ack) {
    const std::string prefix = "VIOLATION_REASON_";
    RejectedItem item{ack.sequence(), {}};
    for (const auto& one : ack.violations()) {
        std::string name = std::to_string(one.reason());
        if (v1::ViolationReason_IsValid(one.reason())) {
            name = v1::ViolationReason_Name(one.reason()).substr(prefix.size());
        }
        item.violations.push_back({one.field(), one.description(), name});
    }
    return item;
}

void drop(std::set<std::int64_t>& waiting, std::int64_t through) {
    waiting.erase(waiting.begin(), waiting.upper_bound(through));
}

}  // namespace

Stream::Stream(std::shared_ptr<const Link> link, std::string map_id, std::string client_id,
               SessionOptions options)
    : link_(std::move(link)),
      map_id_(std::move(map_id)),
      client_id_(std::move(client_id)),
      options_(std::move(options)),
      retries_(options_.retry),
      outbox_(options_.max_unanswered) {}

void Stream::run() noexcept {
    std::optional<Error> failure;
    try {
        failure = run_streams();
    } catch (const std::exception& error) {
        // Memory that is used up, or a bug of ours: it must reach those who wait.
        failure.emplace(ErrorKind::kProtocol, error.what());
    }
    const Lock lock(mutex_);
    failure_ = std::move(failure);
    is_done_ = !failure_;
    changed_.notify_all();
}

std::optional<Error> Stream::run_streams() {
    while (true) {
        const auto ended = stream();
        if (!ended) {
            return std::nullopt;
        }
        link_->follow(*ended);
        const Error error = explain(*ended);
        Lock lock(mutex_);
        if (is_aborted_) {
            return Error(ErrorKind::kClosed, "the session has ended");
        }
        auto next = retries_.next(error, Clock::now());
        if (auto* last = std::get_if<Error>(&next)) {
            return std::move(*last);
        }
        changed_.wait_for(lock, std::get<std::chrono::nanoseconds>(next), [this] { return is_aborted_; });
    }
}

std::shared_ptr<grpc::ClientContext> Stream::begin_call() {
    auto context = std::make_shared<grpc::ClientContext>();
    const Lock lock(mutex_);
    call_ = context;
    if (is_aborted_) {
        context->TryCancel();
    }
    return context;
}

std::optional<Error> Stream::server_instance(std::string& instance_id) {
    const auto context = begin_call();
    link_->prepare(*context);
    context->set_deadline(std::chrono::system_clock::now() + link_->deadline());
    v1::GetServerInfoResponse info;
    v1::ServerService::Stub stub(link_->channel());
    const auto status = stub.GetServerInfo(context.get(), v1::GetServerInfoRequest(), &info);
    if (!status.ok()) {
        return Error::of_call("GetServerInfo", status);
    }
    instance_id = info.instance_id();
    return std::nullopt;
}

/// One stream from its opening to its end; nothing once everything is answered.
std::optional<Error> Stream::stream() {
    if (!instance_id_) {
        std::string instance_id;
        if (auto error = server_instance(instance_id)) {
            return error;
        }
        instance_id_ = std::move(instance_id);
    }
    const auto context = begin_call();
    link_->prepare(*context);
    v1::IngestService::Stub stub(link_->channel());
    const auto call = stub.Ingest(context.get());
    v1::IngestResponse answer;
    if (!call->Write(opening()) || !call->Read(&answer)) {
        const auto status = call->Finish();
        return status.ok() ? broken(kRpc, "the stream ended early") : Error::of_call(kRpc, status);
    }
    if (auto error = opened(answer)) {
        context->TryCancel();
        call->Finish();
        return error;
    }
    return exchange(*call, *context);
}

v1::IngestRequest Stream::opening() {
    v1::IngestRequest request;
    auto& open = *request.mutable_open();
    open.set_map_id(map_id_);
    open.set_client_id(client_id_);
    open.mutable_options()->set_lock_step(options_.lock_step);
    open.mutable_options()->set_omit_solve_summary(options_.omit_solve_summary);
    // The first stream takes the server's next epoch; a later one must be above its own predecessor,
    // and not above that of another process that took over meanwhile. Whether or not the server sees
    // it: this epoch is spent.
    const Lock lock(mutex_);
    open.set_epoch(is_opened_ ? ++epoch_ : 0);
    return request;
}

std::optional<Error> Stream::opened(const v1::IngestResponse& answer) {
    if (!answer.has_opened()) {
        return Error(ErrorKind::kProtocol, "Ingest: the stream did not begin with opened");
    }
    const auto& opened = answer.opened();
    {
        const Lock lock(mutex_);
        if (auto error = check_resumed(opened)) {
            return error;
        }
        retries_.opened();
        epoch_ = std::max(epoch_, opened.epoch());
        outbox_.rewind(opened.durability() != v1::DURABILITY_IN_MEMORY);
        if (!is_opened_) {
            first_ = opened;
            is_opened_ = true;
            changed_.notify_all();
            return std::nullopt;
        }
        ++report_.reconnects;
        if (opened.optimized_sequence() <= report_.optimized_through) {
            return std::nullopt;
        }
    }
    // The broken link may have lost this OPTIMIZED: nobody sends it again.
    v1::IngestAck ack;
    ack.set_sequence(opened.optimized_sequence());
    ack.set_status(v1::ACK_STATUS_OPTIMIZED);
    ack.set_revision(opened.revision());
    return take(ack);
}

/// Whether the server still has what it acknowledged. The mutex is held.
std::optional<Error> Stream::check_resumed(const v1::IngestOpened& opened) const {
    if (!is_opened_) {
        return std::nullopt;
    }
    if (opened.map_uid() != first_.map_uid()) {
        return Error(ErrorKind::kMapReplaced, "map " + map_id_ + " is not the same map as before (uid " +
                                                  opened.map_uid() + ", was " + first_.map_uid() + ")");
    }
    if (opened.next_sequence() <= outbox_.released()) {
        return Error(ErrorKind::kItemsLost,
                     "the server lost items: it continues at " + std::to_string(opened.next_sequence()) +
                         ", but " + std::to_string(outbox_.released()) + " was acknowledged");
    }
    return std::nullopt;
}

/// Sends items and takes acks until the stream ends.
std::optional<Error> Stream::exchange(Call& call, grpc::ClientContext& context) {
    bool is_over = false;
    std::thread sender(&Stream::send_all, this, std::ref(call), std::cref(is_over));
    std::optional<Error> error;
    v1::IngestResponse answer;
    try {
        while (!error && call.Read(&answer)) {
            if (answer.has_ack()) {
                error = take(answer.ack());
            } else if (answer.has_opened()) {
                error = Error(ErrorKind::kProtocol, "Ingest: the stream was opened twice");
            }
        }
    } catch (const std::exception& failed) {
        // Memory that is used up: the sender must end before this thread does.
        error = Error(ErrorKind::kProtocol, failed.what());
    }
    if (error) {
        context.TryCancel();
    }
    const auto status = call.Finish();
    {
        const Lock lock(mutex_);
        is_over = true;
        changed_.notify_all();
    }
    // Ends a write that waits for room.
    context.TryCancel();
    sender.join();
    if (error) {
        return error;
    }
    if (!status.ok()) {
        return Error::of_call(kRpc, status);
    }
    const Lock lock(mutex_);
    if (is_closing_ && outbox_.is_answered()) {
        return std::nullopt;
    }
    return broken(kRpc, "the stream ended early");
}

void Stream::send_all(Call& call, const bool& is_over) {
    Lock lock(mutex_);
    while (!is_over) {
        if (const Request request = outbox_.take_unsent()) {
            lock.unlock();
            // Where the transport takes no more, late acks and the reason come inbound.
            if (!call.Write(*request)) {
                return;
            }
            lock.lock();
        } else if (is_closing_) {
            lock.unlock();
            // The server then answers what is outstanding and ends the stream.
            call.WritesDone();
            return;
        } else {
            changed_.wait(lock);
        }
    }
}

std::optional<Error> Stream::take(const v1::IngestAck& ack) {
    std::optional<RejectedItem> told;
    {
        const Lock lock(mutex_);
        bool is_new = true;
        const std::int64_t sequence = ack.sequence();
        switch (ack.status()) {
            case v1::ACK_STATUS_RECEIVED:
            case v1::ACK_STATUS_REJECTED: {
                const bool is_received = ack.status() == v1::ACK_STATUS_RECEIVED;
                const auto before = is_received ? outbox_.received(sequence) : outbox_.rejected(sequence);
                if (!before) {
                    return Error(ErrorKind::kProtocol, "Ingest: an ack names an item that was not sent");
                }
                is_new = !before->is_received;
                if (is_new && ack.duplicate() && !before->was_resent) {
                    // An earlier session sent it, and was told of its solve.
                    waiting_[By::kOptimized].erase(sequence);
                }
                break;
            }
            case v1::ACK_STATUS_DURABLE: outbox_.durable(sequence); break;
            case v1::ACK_STATUS_OPTIMIZED: break;
            default: return std::nullopt;  // A status that this client does not know.
        }
        retries_.progress();
        if (is_new && ack.status() == v1::ACK_STATUS_REJECTED) {
            told = rejected_item(ack);
            reject(*told);
        } else if (is_new) {
            count(ack);
        }
    }
    std::optional<Error> error;
    if (told && options_.on_rejected) {
        error = call_back(options_.on_rejected, *told);
    }
    if (!error && options_.on_ack) {
        error = call_back(options_.on_ack, ack);
    }
    changed_.notify_all();
    return error;
}

/// Adds an ack of an item that was taken and not counted yet. The mutex is held.
void Stream::count(const v1::IngestAck& ack) {
    const std::int64_t sequence = ack.sequence();
    report_.revision = std::max(report_.revision, ack.revision());
    switch (ack.status()) {
        case v1::ACK_STATUS_RECEIVED:
            ++report_.acknowledged;
            report_.duplicates += ack.duplicate() ? 1 : 0;
            waiting_[By::kAnswer].erase(sequence);
            declared_.erase(sequence);
            break;
        case v1::ACK_STATUS_DURABLE:
            report_.durable_through = std::max(report_.durable_through, sequence);
            drop(waiting_[By::kDurable], sequence);
            break;
        default:
            ++report_.optimized;
            report_.optimized_through = std::max(report_.optimized_through, sequence);
            report_.failed_solves += ack.has_solve_failure() ? 1 : 0;
            drop(waiting_[By::kOptimized], sequence);
            break;
    }
}

/// Adds an item that was refused. The mutex is held.
void Stream::reject(const RejectedItem& item) {
    ++report_.rejected;
    refused_.insert(item.sequence);
    for (auto& [by, waiting] : waiting_) {
        waiting.erase(item.sequence);
    }
    // Landmarks of an item that was refused are not in the map.
    const auto declared = declared_.find(item.sequence);
    if (declared != declared_.end()) {
        for (const std::int64_t id : declared->second) {
            landmarks_.erase(id);
        }
        declared_.erase(declared);
    }
    if (report_.rejections.size() < IngestReport::kKeptRejections) {
        report_.rejections.push_back(item);
    }
    if (!options_.on_rejected && untold_.size() < IngestReport::kKeptRejections) {
        untold_.push_back(item);
    }
}

/// Tells a fenced stream and a restarted server from other ends.
Error Stream::explain(Error error) {
    if (error.kind() != ErrorKind::kRpc) {
        return error;
    }
    if (error.code() == grpc::StatusCode::ABORTED) {
        return Error(ErrorKind::kFenced,
                     "another stream of client " + client_id_ + " on map " + map_id_ + " has taken over");
    }
    if (error.code() == grpc::StatusCode::NOT_FOUND && is_opened_) {
        std::string instance_id;
        if (!server_instance(instance_id) && instance_id != *instance_id_) {
            return Error(ErrorKind::kServerRestarted, "the server was restarted (instance " + instance_id +
                                                          ") and has no map " + map_id_ + " any more");
        }
    }
    return error;
}

}  // namespace covis::detail
