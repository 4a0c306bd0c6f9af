//! What a program's own threads do with a session: send items, wait for acks, end it. `stream.cpp` has
//! the threads that move them.

#include "stream.hpp"

#include <algorithm>

namespace covis::detail {

void Stream::open() {
    runner_ = std::thread(&Stream::run, this);
    Lock lock(mutex_);
    until(lock, std::nullopt, "", [this] { return is_opened_; });
}

std::int64_t Stream::next_sequence() const {
    const Lock lock(mutex_);
    return std::max(first_.next_sequence(), last_sequence_ + 1);
}

IngestReport Stream::report() const {
    const Lock lock(mutex_);
    return report_;
}

void Stream::know(const std::vector<std::int64_t>& landmarks) {
    const Lock lock(mutex_);
    landmarks_.insert(landmarks.begin(), landmarks.end());
}

void Stream::forget(const std::vector<std::int64_t>& landmarks) {
    const Lock lock(mutex_);
    for (const std::int64_t id : landmarks) {
        landmarks_.erase(id);
    }
}

std::vector<std::int64_t> Stream::unknown(const std::vector<std::int64_t>& landmarks) const {
    const Lock lock(mutex_);
    std::set<std::int64_t> found;
    for (const std::int64_t id : landmarks) {
        if (landmarks_.count(id) == 0) {
            found.insert(id);
        }
    }
    return {found.begin(), found.end()};
}

std::vector<v1::IngestRequest> Stream::unanswered() const {
    const Lock lock(mutex_);
    std::vector<v1::IngestRequest> all;
    for (const auto& request : outbox_.requests()) {
        all.push_back(*request);
    }
    return all;
}

std::int64_t Stream::send(v1::IngestRequest item, bool is_solved, std::vector<std::int64_t> declared,
                          std::optional<std::int64_t> number) {
    Lock lock(mutex_);
    const std::int64_t sequence = number.value_or(std::max(first_.next_sequence(), last_sequence_ + 1));
    if (sequence <= last_sequence_) {
        throw Error(ErrorKind::kArgument, "sequence " + std::to_string(sequence) + " is not above " +
                                              std::to_string(last_sequence_));
    }
    item.set_sequence(sequence);
    const std::size_t size = item.ByteSizeLong();
    if (size > static_cast<std::size_t>(first_.max_message_bytes())) {
        throw Error(ErrorKind::kTooLarge, "the item has " + std::to_string(size) +
                                              " bytes, and the server accepts messages of at most " +
                                              std::to_string(first_.max_message_bytes()));
    }
    until(lock, std::nullopt, "", [this] { return is_closing_ || outbox_.has_room(); });
    check_open();
    if (is_closing_) {
        throw Error(ErrorKind::kClosed, "the session has ended");
    }
    last_sequence_ = sequence;
    outbox_.push(std::make_shared<const v1::IngestRequest>(std::move(item)));
    ++report_.sent;
    waiting_[By::kAnswer].insert(sequence);
    if (!is_in_memory()) {
        waiting_[By::kDurable].insert(sequence);
    }
    if (is_solved) {
        waiting_[By::kOptimized].insert(sequence);
    }
    landmarks_.insert(declared.begin(), declared.end());
    if (!declared.empty()) {
        declared_.emplace(sequence, std::move(declared));
    }
    changed_.notify_all();
    return sequence;
}

void Stream::wait(By by, std::optional<std::int64_t> sequence, Timeout timeout, bool tells_refusals,
                  const char* what) {
    Lock lock(mutex_);
    if (by == By::kDurable && is_in_memory()) {
        throw Error(ErrorKind::kNotDurable,
                    "the server keeps maps in memory only, so that nothing becomes durable");
    }
    if (!sequence) {
        const std::int64_t last = last_sequence_;
        until(lock, timeout, what, [&] { return !waits(by, last) && !waits(By::kAnswer, last); });
        if (tells_refusals) {
            throw_untold();
        }
        return;
    }
    until(lock, timeout, what,
          [&] { return refused_.count(*sequence) != 0 || !waits(by, *sequence); });
    if (refused_.count(*sequence) != 0) {
        const auto is_it = [&](const RejectedItem& item) { return item.sequence == *sequence; };
        const auto kept = std::find_if(report_.rejections.begin(), report_.rejections.end(), is_it);
        RejectedItem item{*sequence, {}};
        if (kept != report_.rejections.end()) {
            item = *kept;
        }
        untold_.erase(std::remove_if(untold_.begin(), untold_.end(), is_it), untold_.end());
        throw Error::rejected({item});
    }
}

void Stream::finish(Timeout timeout) {
    Lock lock(mutex_);
    is_closing_ = true;
    changed_.notify_all();
    until(lock, timeout, "the session did not end", [this] { return is_done_; });
    throw_untold();
}

void Stream::abort() noexcept {
    {
        const Lock lock(mutex_);
        is_aborted_ = true;
        if (call_) {
            call_->TryCancel();
        }
        changed_.notify_all();
    }
    if (runner_.joinable()) {
        runner_.join();
    }
}

bool Stream::waits(By by, std::int64_t through) const {
    const auto found = waiting_.find(by);
    return found != waiting_.end() && !found->second.empty() && *found->second.begin() <= through;
}

void Stream::check_open() const {
    if (failure_) {
        throw Error(*failure_);
    }
    if (is_done_ || is_aborted_) {
        throw Error(ErrorKind::kClosed, "the session has ended");
    }
}

void Stream::throw_untold() {
    std::vector<RejectedItem> items;
    items.swap(untold_);
    if (!items.empty()) {
        throw Error::rejected(std::move(items));
    }
}

template <class Met>
void Stream::until(Lock& lock, Timeout timeout, const char* what, Met met) {
    const auto deadline = Clock::now() + timeout.value_or(std::chrono::milliseconds(0));
    while (!met()) {
        check_open();
        if (!timeout) {
            changed_.wait(lock);
        } else if (changed_.wait_until(lock, deadline) == std::cv_status::timeout && !met()) {
            check_open();
            throw Error(ErrorKind::kTimeout,
                        std::string(what) + " within " + std::to_string(timeout->count()) + " ms");
        }
    }
}

}  // namespace covis::detail
