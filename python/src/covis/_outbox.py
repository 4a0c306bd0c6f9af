"""The items that the server has not answered yet, in order: what a broken link must send again.

An entry is waiting (not yet on this stream), sent, or received (kept only while the server will still
tell DURABLE). Entries leave with RECEIVED or REJECTED, on a durable server with DURABLE. A state machine
without clock, task or channel.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass


@dataclass
class Entry:
    """An item in memory."""

    request: bytes
    """The message, sequence included."""
    is_sent: bool = False
    """Whether it is on the present stream."""
    was_resent: bool = False
    """Whether it was on an earlier stream too."""
    is_received: bool = False
    """Whether RECEIVED came already."""


class Outbox:
    """The unanswered items."""

    def __init__(self, capacity: int) -> None:
        self._entries: dict[int, Entry] = {}
        self._unsent: deque[int] = deque()
        self._capacity = max(1, capacity)
        self._keeps_until_durable = False
        self.released = 0
        """The highest sequence that only the server holds."""

    @property
    def has_room(self) -> bool:
        """Whether another item fits."""
        return len(self._entries) < self._capacity

    @property
    def has_unsent(self) -> bool:
        """Whether a message is not on the present stream."""
        return bool(self._unsent)

    @property
    def is_answered(self) -> bool:
        """Whether everything was sent and nothing waits for an answer."""
        return not self._unsent and all(e.is_received for e in self._entries.values())

    @property
    def requests(self) -> list[bytes]:
        """The messages of all entries, by sequence."""
        return [entry.request for entry in list(self._entries.values())]

    def push(self, sequence: int, request: bytes) -> None:
        """Appends an item, whose sequence is above all before."""
        self._entries[sequence] = Entry(request)
        self._unsent.append(sequence)

    def rewind(self, keeps_until_durable: bool) -> None:
        """Begins a new stream: everything is to be sent again."""
        for entry in self._entries.values():
            entry.was_resent |= entry.is_sent
            entry.is_sent = False
        self._unsent = deque(self._entries)
        self._keeps_until_durable = keeps_until_durable

    def take_unsent(self) -> bytes | None:
        """The next message that is not on the present stream; it is on its way now."""
        if not self._unsent:
            return None
        entry = self._entries[self._unsent.popleft()]
        entry.is_sent = True
        return entry.request

    def received(self, sequence: int) -> Entry | None:
        """Takes RECEIVED; the entry as it was before, `None` where no such item was sent."""
        return self._answered(sequence, leaves=not self._keeps_until_durable)

    def rejected(self, sequence: int) -> Entry | None:
        """Takes REJECTED; the entry as it was before, `None` where no such item was sent."""
        return self._answered(sequence, leaves=True, is_released=False)

    def durable(self, sequence: int) -> None:
        """Takes DURABLE up to `sequence`."""
        for key in list(self._entries):
            if key > sequence or not self._entries[key].is_received:
                break
            del self._entries[key]
        self.released = max(self.released, sequence)

    def _answered(self, sequence: int, leaves: bool, is_released: bool = True) -> Entry | None:
        entry = self._entries.get(sequence)
        if entry is None or not entry.is_sent:
            return None
        before = Entry(b"", True, entry.was_resent, entry.is_received)
        entry.is_received = True
        if leaves:
            del self._entries[sequence]
            if is_released:
                self.released = max(self.released, sequence)
        return before
