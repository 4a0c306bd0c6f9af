"""How often and how soon a broken link is tried again: exponential backoff with jitter.

Attempt k waits min(first · 2^k, longest), shortened at random by up to a half so that many robots do
not come back in one instant; never less than what the server asked for. Attempts are counted since the
last progress, so that a long session survives many short outages; the time is counted since the link
broke.
"""

from __future__ import annotations

import asyncio
import logging
import random
import time
from dataclasses import dataclass

from .errors import CovisError, RetriesExhausted, RpcError, is_transient

_LOG = logging.getLogger("covis")


@dataclass(frozen=True)
class RetryPolicy:
    """When to give up."""

    max_attempts: int = 8
    """Attempts without progress after which a session fails."""
    first_delay_s: float = 0.1
    """Wait before the second attempt."""
    longest_delay_s: float = 5.0
    """Longest wait."""
    give_up_after_s: float | None = None
    """How long a link may be broken before a session fails."""
    seed: int | None = None
    """What the random part of the waits is drawn from, for runs that must repeat exactly."""


class Retries:
    """Attempts since the last progress."""

    def __init__(self, policy: RetryPolicy) -> None:
        self._policy = policy
        self._random = random.Random(policy.seed)
        self._failed = 0
        self._broken_since: float | None = None

    def opened(self) -> None:
        """The link stands again. The attempts still count: it may break at once."""
        self._broken_since = None

    def progress(self) -> None:
        """Forgets the failures so far."""
        self._failed = 0

    async def wait(self, error: CovisError) -> None:
        """Waits before the next attempt; raises `error` where it is final or was the last straw."""
        if not is_transient(error):
            raise error
        self._failed += 1
        now = time.monotonic()
        if self._broken_since is None:
            self._broken_since = now
        left = None
        if self._policy.give_up_after_s is not None:
            left = max(0.0, self._policy.give_up_after_s - (now - self._broken_since))
        if self._failed >= self._policy.max_attempts or left == 0.0:
            raise RetriesExhausted(self._failed, error)
        delay = self.delay(self._random.random())
        if isinstance(error, RpcError) and error.retry_after_s is not None:
            delay = max(delay, error.retry_after_s)
        if left is not None:
            delay = min(delay, left)
        _LOG.debug("trying again in %.3f s (attempt %d): %s", delay, self._failed, error)
        await asyncio.sleep(delay)

    def delay(self, jitter: float) -> float:
        """The wait after the failures so far; `jitter` within 0 to 1."""
        full = self._policy.first_delay_s * 2.0 ** min(max(self._failed - 1, 0), 20)
        return min(full, self._policy.longest_delay_s) * (1.0 - 0.5 * jitter)
