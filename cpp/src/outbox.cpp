//! The items that the server has not answered yet.

#include "outbox.hpp"

#include <algorithm>

namespace covis::detail {

bool Outbox::is_answered() const {
    return unsent_.empty() && std::all_of(entries_.begin(), entries_.end(),
                                          [](const auto& entry) { return entry.second.is_received; });
}

std::vector<Request> Outbox::requests() const {
    std::vector<Request> all;
    for (const auto& [sequence, entry] : entries_) {
        all.push_back(entry.request);
    }
    return all;
}

void Outbox::push(Request request) {
    const std::int64_t sequence = request->sequence();
    entries_[sequence].request = std::move(request);
    unsent_.push_back(sequence);
}

void Outbox::rewind(bool keeps_until_durable) {
    keeps_until_durable_ = keeps_until_durable;
    unsent_.clear();
    for (auto& [sequence, entry] : entries_) {
        entry.was_resent = entry.was_resent || entry.is_sent;
        entry.is_sent = false;
        unsent_.push_back(sequence);
    }
}

Request Outbox::take_unsent() {
    if (unsent_.empty()) {
        return nullptr;
    }
    Entry& entry = entries_.at(unsent_.front());
    unsent_.pop_front();
    entry.is_sent = true;
    return entry.request;
}

std::optional<Entry> Outbox::received(std::int64_t sequence) {
    return answered(sequence, !keeps_until_durable_, true);
}

std::optional<Entry> Outbox::rejected(std::int64_t sequence) {
    return answered(sequence, true, false);
}

void Outbox::durable(std::int64_t sequence) {
    while (!entries_.empty() && entries_.begin()->first <= sequence &&
           entries_.begin()->second.is_received) {
        entries_.erase(entries_.begin());
    }
    released_ = std::max(released_, sequence);
}

std::optional<Entry> Outbox::answered(std::int64_t sequence, bool leaves, bool is_released) {
    const auto found = entries_.find(sequence);
    if (found == entries_.end() || !found->second.is_sent) {
        return std::nullopt;
    }
    Entry before = found->second;
    found->second.is_received = true;
    if (leaves) {
        entries_.erase(found);
        if (is_released) {
            released_ = std::max(released_, sequence);
        }
    }
    return before;
}

}  // namespace covis::detail
