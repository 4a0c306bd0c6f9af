//! Exponential backoff with jitter.

#include "retry.hpp"

#include <algorithm>
#include <cmath>

namespace covis::detail {

Retries::Retries(const RetryPolicy& policy)
    : policy_(policy), random_(policy.seed ? *policy.seed : std::random_device{}()) {}

std::variant<std::chrono::nanoseconds, Error> Retries::next(const Error& error, Clock::time_point now) {
    using std::chrono::duration_cast;
    using std::chrono::nanoseconds;
    if (!error.is_transient()) {
        return error;
    }
    ++failed_;
    broken_since_ = broken_since_.value_or(now);
    std::optional<nanoseconds> left;
    if (policy_.give_up_after) {
        left = std::max(nanoseconds(0), nanoseconds(*policy_.give_up_after) - (now - *broken_since_));
    }
    if (failed_ >= policy_.max_attempts || left == nanoseconds(0)) {
        return Error::exhausted(failed_, error);
    }
    const double doubled = std::ldexp(1.0, std::min(failed_ - 1, 20));
    const double full = std::min(static_cast<double>(policy_.first_delay.count()) * doubled,
                                 static_cast<double>(policy_.longest_delay.count()));
    const double jitter = std::uniform_real_distribution<double>(0.0, 1.0)(random_);
    auto delay = duration_cast<nanoseconds>(
        std::chrono::duration<double, std::milli>(full * (1.0 - 0.5 * jitter)));
    delay = std::max(delay, error.retry_after().value_or(nanoseconds(0)));
    return left ? std::min(delay, *left) : delay;
}

}  // namespace covis::detail
