//! How links, retries, sessions and watches behave, and what a session reports.

#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "covis/error.hpp"
#include "covis/v1/ingest_service.pb.h"
#include "covis/v1/map_service.pb.h"

namespace covis {

/// How long a call may wait; without a value for as long as it takes.
using Timeout = std::optional<std::chrono::milliseconds>;

/// When a broken link is given up. Attempt k waits min(first · 2^k, longest), shortened at random by up
/// to a half, and never less than what the server asked for. Attempts are counted since the last
/// progress.
struct RetryPolicy {
    /// Attempts without progress after which a session fails.
    int max_attempts = 8;
    /// Wait before the second attempt.
    std::chrono::milliseconds first_delay{100};
    /// Longest wait.
    std::chrono::milliseconds longest_delay{5'000};
    /// How long a link may be broken before a session fails.
    Timeout give_up_after;
    /// What the random part of the waits is drawn from, for runs that must repeat exactly.
    std::optional<std::uint64_t> seed;
};

/// Times of a link, and how it is used.
struct LinkOptions {
    /// How long a connection may take to stand.
    std::chrono::milliseconds connect_timeout{10'000};
    /// A connection is probed (HTTP/2 PING) after so long without a word from the server.
    std::chrono::milliseconds keep_alive{10'000};
    /// It is given up when a probe is not answered for so long.
    std::chrono::milliseconds keep_alive_timeout{10'000};
    /// How long a call with one answer may take, those that solve left out.
    std::chrono::milliseconds deadline{30'000};
    /// Messages travel compressed (gzip), for links that are slow.
    bool compress = false;
    /// How often a call with one answer is made again, within its deadline: see `Error::may_repeat`.
    RetryPolicy retry;
};

/// What a client shows, and whom it trusts.
struct ConnectOptions {
    /// One of the server's tokens, or a JSON Web Token. By default that of `token_file`, else of the
    /// variables `COVIS_TOKEN_FILE` and `COVIS_TOKEN`.
    std::optional<std::string> token;
    std::string token_file;
    /// File with the authorities (PEM) that are trusted instead of those of the system.
    std::string ca_file;
    /// The client's own certificate and key (PEM), for mutual TLS; both or none.
    std::string cert_file;
    std::string key_file;
    LinkOptions link;
};

/// How a session behaves. Callbacks run on a thread of the session: they must not block and not call
/// the session; one that throws ends it.
struct SessionOptions {
    /// Creates the map, with `policy`, where it is missing.
    bool create = true;
    std::optional<v1::MapPolicy> policy;
    /// Items without an answer; with more of them sending waits.
    std::size_t max_unanswered = 64;
    /// Each solve finishes before the server takes the next item.
    bool lock_step = false;
    /// Acks come without the certificates of solves.
    bool omit_solve_summary = false;
    RetryPolicy retry;
    /// Called with each ack.
    std::function<void(const v1::IngestAck&)> on_ack;
    /// Called with each item that was refused for good; without it waiting and `finish` throw.
    std::function<void(const RejectedItem&)> on_rejected;
};

/// How far a session has come.
struct IngestReport {
    /// Refused items that are kept in full.
    static constexpr std::size_t kKeptRejections = 100;

    /// Items that were handed over.
    std::int64_t sent = 0;
    /// Items that the server took.
    std::int64_t acknowledged = 0;
    /// Those of them that it had already.
    std::int64_t duplicates = 0;
    /// Items that it refused.
    std::int64_t rejected = 0;
    /// The first `kKeptRejections` of them.
    std::vector<RejectedItem> rejections;
    /// The last sequence that is on the server's disk; 0 before the first.
    std::int64_t durable_through = 0;
    /// OPTIMIZED acks; one may cover several items.
    std::int64_t optimized = 0;
    /// The last sequence that solves have covered; 0 before the first.
    std::int64_t optimized_through = 0;
    /// OPTIMIZED acks that told of a problem that cannot be solved as posed.
    std::int64_t failed_solves = 0;
    /// The highest revision of the map that an ack named.
    std::int64_t revision = 0;
    /// Streams opened after the first: how often the link broke.
    std::int64_t reconnects = 0;

    /// Items without an answer.
    std::int64_t unanswered() const noexcept { return sent - acknowledged - rejected; }
};

/// An entity by its client and its id. Where a session sends it, an empty client is its own.
struct Ref {
    std::string client_id;
    std::int64_t id = 0;

    Ref() = default;
    Ref(std::int64_t id_) : id(id_) {}  // NOLINT: an id alone names an entity of one's own.
    Ref(std::string client, std::int64_t id_) : client_id(std::move(client)), id(id_) {}

    friend bool operator<(const Ref& a, const Ref& b) {
        return std::tie(a.client_id, a.id) < std::tie(b.client_id, b.id);
    }
    friend bool operator==(const Ref& a, const Ref& b) {
        return a.id == b.id && a.client_id == b.client_id;
    }
};

/// What a delta changed.
struct MapChanges {
    /// The revision that it led to.
    std::int64_t revision = 0;
    /// Whether it began anew: what it does not name is gone.
    bool reset = false;
    /// Keyframes that are new, moved or gone.
    std::vector<Ref> keyframes;
    /// The same of landmarks.
    std::vector<Ref> landmarks;
    /// The same of constraints and priors.
    std::vector<Ref> constraints;
};

/// What is watched. The callback runs on a thread of the watch: it must not block and not wait for the
/// watch; if it throws, the watch ends.
struct WatchOptions {
    bool omit_landmarks = false;
    bool omit_constraints = false;
    /// Positions that change by less wait until they have changed more, m.
    double position_resolution_m = 0.0;
    /// The same of rotations, rad.
    double rotation_resolution_rad = 0.0;
    RetryPolicy retry;
    /// Called after each delta.
    std::function<void(const MapChanges&)> on_change;
};

}  // namespace covis
