//! How often and how soon a broken link is tried again: exponential backoff with jitter. No clock and
//! no thread: the caller waits, and says what time it is.

#pragma once

#include <chrono>
#include <optional>
#include <random>
#include <variant>

#include "covis/options.hpp"

namespace covis::detail {

using Clock = std::chrono::steady_clock;

/// Attempts since the last progress.
class Retries {
  public:
    explicit Retries(const RetryPolicy& policy);

    /// The link stands again. The attempts still count: it may break at once.
    void opened() { broken_since_.reset(); }
    /// Forgets the failures so far.
    void progress() { failed_ = 0; }
    /// The wait before the next attempt, or the error that ends the session.
    std::variant<std::chrono::nanoseconds, Error> next(const Error& error, Clock::time_point now);

  private:
    RetryPolicy policy_;
    std::mt19937_64 random_;
    int failed_ = 0;
    std::optional<Clock::time_point> broken_since_;
};

}  // namespace covis::detail
