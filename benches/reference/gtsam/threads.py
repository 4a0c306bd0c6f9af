"""How many processors GTSAM may use; it has no option for threads (Linux)."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def bound(count: int | None) -> Iterator[None]:
    """Binds the process to `count` processors around the import of GTSAM, whose pool counts them then.

    A GTSAM without a pool (pip's has none) may go wherever it likes afterwards: bound, it could not
    leave a processor that others use too.
    """
    before = os.sched_getaffinity(0)
    if count:
        os.sched_setaffinity(0, sorted(before)[:count])
    yield
    if not has_pool():
        os.sched_setaffinity(0, before)


def has_pool() -> bool:
    """Whether the library that GTSAM takes its threads from is loaded."""
    with open("/proc/self/maps", encoding="utf-8", errors="replace") as lines:
        return any("libtbb" in line for line in lines)


def used() -> int:
    """Threads that GTSAM has."""
    return len(os.sched_getaffinity(0)) if has_pool() else 1
