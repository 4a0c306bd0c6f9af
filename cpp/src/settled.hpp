//! Waiting until a map is settled: the server does nothing more to it by itself.

#pragma once

#include <string>

#include "link.hpp"

namespace covis::detail {

/// See `Client::wait_settled`. `GetMap` says what is pending; while something is, a watch that leaves out
/// the entities says when nothing is. A link that breaks is tried again as that of a watch.
void wait_settled(const Link& link, const std::string& map_id, Timeout timeout, const RetryPolicy& policy);

}  // namespace covis::detail
