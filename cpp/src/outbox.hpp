//! The items that the server has not answered yet, in order: what a broken link must send again.
//!
//! An entry is waiting (not yet on this stream), sent, or received (kept only while the server will
//! still tell DURABLE). Entries leave with RECEIVED or REJECTED, on a durable server with DURABLE. A
//! state machine without clock, thread or channel.

#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <optional>
#include <vector>

#include "covis/v1/ingest_service.pb.h"

namespace covis::detail {

using Request = std::shared_ptr<const v1::IngestRequest>;

/// An item in memory.
struct Entry {
    Request request;
    /// Whether it is on the present stream.
    bool is_sent = false;
    /// Whether it was on an earlier stream too.
    bool was_resent = false;
    /// Whether RECEIVED came already.
    bool is_received = false;
};

/// The unanswered items.
class Outbox {
  public:
    explicit Outbox(std::size_t capacity) : capacity_(capacity == 0 ? 1 : capacity) {}

    /// Whether another item fits.
    bool has_room() const { return entries_.size() < capacity_; }
    /// Whether everything was sent and nothing waits for an answer.
    bool is_answered() const;
    /// The highest sequence that only the server holds.
    std::int64_t released() const { return released_; }

    /// The messages of all entries, by sequence.
    std::vector<Request> requests() const;

    /// Appends an item, whose sequence is above all before.
    void push(Request request);
    /// Begins a new stream: everything is to be sent again.
    void rewind(bool keeps_until_durable);
    /// The next item for the stream, which counts as sent; null where there is none.
    Request take_unsent();
    /// Takes RECEIVED or REJECTED; the entry as it was before, nothing where no such item was sent.
    std::optional<Entry> received(std::int64_t sequence);
    std::optional<Entry> rejected(std::int64_t sequence);
    /// Takes DURABLE up to `sequence`.
    void durable(std::int64_t sequence);

  private:
    std::optional<Entry> answered(std::int64_t sequence, bool leaves, bool is_released);

    std::map<std::int64_t, Entry> entries_;
    std::deque<std::int64_t> unsent_;
    std::size_t capacity_;
    bool keeps_until_durable_ = false;
    std::int64_t released_ = 0;
};

}  // namespace covis::detail
