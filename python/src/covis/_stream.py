"""The task behind a session: one stream after the other until every item is answered.

On each stream: open with an epoch above the last one, send what is unanswered, then what comes, and take
acks. A stream that breaks is followed by the next (`_retry.py`); a fenced one, a replaced map or a server
that lost what it had acknowledged ends the session with the reason. It knows items as bytes only.
"""

from __future__ import annotations

import asyncio
import dataclasses
import logging
from collections.abc import Callable
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, field
from typing import Any

import grpc
import grpc.aio

from . import errors
from ._link import Link
from ._outbox import Outbox
from ._retry import Retries, RetryPolicy
from ._wait import Signal, end
from .errors import RejectedItem
from .v1 import (
    AckStatus,
    Durability,
    GetServerInfoRequest,
    IngestAck,
    IngestOpen,
    IngestOpened,
    IngestOptions,
    IngestRequest,
    IngestResponse,
)

_LOG = logging.getLogger("covis")
_RPC = "Ingest"

KEPT_REJECTIONS = 100
"""Refused items that a report keeps in full."""


@dataclass(frozen=True)
class SessionOptions:
    """How a session behaves."""

    max_unanswered: int = 64
    lock_step: bool = False
    omit_solve_summary: bool = False
    retry: RetryPolicy = RetryPolicy()
    on_ack: Callable[[IngestAck], None] | None = None
    on_rejected: Callable[[RejectedItem], None] | None = None


@dataclass
class IngestReport:
    """How far a session has come."""

    sent: int = 0
    """Items that were handed over."""
    acknowledged: int = 0
    """Items that the server took."""
    duplicates: int = 0
    """Those of them that it had already."""
    rejected: int = 0
    """Items that it refused."""
    rejections: list[RejectedItem] = field(default_factory=list)
    """The first `KEPT_REJECTIONS` of them."""
    durable_through: int = 0
    """The last sequence that is on the server's disk; 0 before the first."""
    optimized: int = 0
    """OPTIMIZED acks; one may cover several items."""
    optimized_through: int = 0
    """The last sequence that solves have covered; 0 before the first."""
    failed_solves: int = 0
    """OPTIMIZED acks that told of a problem that cannot be solved as posed."""
    revision: int = 0
    """The highest revision of the map that an ack named."""
    reconnects: int = 0
    """Streams opened after the first: how often the link broke."""

    @property
    def unanswered(self) -> int:
        """Items without an answer."""
        return self.sent - self.acknowledged - self.rejected


class Stream:
    """The items of a session on their way."""

    def __init__(self, link: Link, map_id: str, client_id: str, options: SessionOptions) -> None:
        self._link = link
        self._map_id = map_id
        self._client_id = client_id
        self._options = options
        self._retries = Retries(options.retry)
        self._outbox = Outbox(options.max_unanswered)
        self._arrived = Signal()
        self._changed = Signal()
        self._instance_id: str | None = None
        self._first: IngestOpened | None = None
        self._epoch = 0
        self._task: asyncio.Task[None] | None = None
        self._is_closing = False
        self._failure: BaseException | None = None
        self._declared: dict[int, AbstractSet[int]] = {}
        # Sequences that wait for an ack, rising; dictionaries as sorted sets.
        self._waiting: dict[str, dict[int, None]] = {"answer": {}, "durable": {}, "optimized": {}}
        self.is_done = False
        self.report = IngestReport()
        self.rejected: set[int] = set()
        self.untold: list[RejectedItem] = []
        """Refused items of which nobody was told yet."""
        self.on_dismissed: Callable[[AbstractSet[int]], None] | None = None
        """Called with the landmarks that a refused item would have declared."""

    @property
    def first(self) -> IngestOpened:
        """The answer to the first opening."""
        if self._first is None:
            raise errors.Closed
        return self._first

    @property
    def unanswered(self) -> tuple[IngestRequest, ...]:
        """The items that the server may not have, by sequence."""
        return tuple(IngestRequest.FromString(request) for request in self._outbox.requests)

    @property
    def is_in_memory(self) -> bool:
        """Whether DURABLE never comes."""
        return self.first.durability == Durability.DURABILITY_IN_MEMORY

    def copy_report(self) -> IngestReport:
        """The report as it is now."""
        return dataclasses.replace(self.report, rejections=list(self.report.rejections))

    async def open(self) -> None:
        """Begins the first stream."""
        self._task = asyncio.get_running_loop().create_task(self._run())
        try:
            await self.until(lambda: self._first is not None)
        except BaseException:
            await self.abort()
            raise

    async def room(self) -> None:
        """Waits until another item fits."""
        while True:
            self._check_open()
            if self._is_closing:
                raise errors.Closed
            if self._outbox.has_room:
                return
            await self._changed.wait()

    def push(self, sequence: int, request: bytes, is_solved: bool, declared: AbstractSet[int]) -> None:
        """Hands an item over for which there is room."""
        self._outbox.push(sequence, request)
        self.report.sent += 1
        self._waiting["answer"][sequence] = None
        if not self.is_in_memory:
            self._waiting["durable"][sequence] = None
        if is_solved:
            self._waiting["optimized"][sequence] = None
        if declared:
            self._declared[sequence] = declared
        self._arrived.fire()

    def waits(self, by: str, through: int) -> bool:
        """Whether an item up to this sequence waits for an ack of this kind."""
        first = next(iter(self._waiting[by]), None)
        return first is not None and first <= through

    async def until(self, met: Callable[[], bool]) -> None:
        """Waits for a state; raises why the session ended before it came."""
        while not met():
            self._check_open()
            await self._changed.wait()

    def _check_open(self) -> None:
        if self._failure is not None:
            raise self._failure.with_traceback(None)
        if self.is_done or self._task is None:
            raise errors.Closed

    def close(self) -> None:
        """Nothing more will be pushed."""
        self._is_closing = True
        self._arrived.fire()

    async def abort(self) -> None:
        """Ends it at once."""
        await end(self._task)
        if not self.is_done and self._failure is None:
            self._failure = errors.Closed()
        self._changed.fire()

    async def _run(self) -> None:
        """Runs streams until the session is done or fails."""
        try:
            while True:
                try:
                    await self._stream()
                    self.is_done = True
                    return
                except errors.CovisError as error:
                    self._link.follow(error)
                    await self._retries.wait(await self._explain(error))
        except Exception as error:  # A bug of ours too must reach those who wait.
            if isinstance(error, errors.CovisError):
                error.unanswered = self.unanswered
            self._failure = error
        finally:
            self._changed.fire()

    async def _stream(self) -> None:
        """One stream from opening to its end; returns once everything is answered."""
        if self._instance_id is None:
            info = await self._link.unary_once(GetServerInfoRequest(), self._link.deadline_s)
            self._instance_id = info.instance_id
        call = self._link.raw_stream(IngestRequest, IngestResponse.FromString)
        try:
            await self._open(call)
            answer = await _read(call)
            if answer is None or answer.WhichOneof("event") != "opened":
                raise errors.Protocol(f"{_RPC}: the stream did not begin with opened")
            opened = answer.opened
            self._check_resumed(opened)
            self._retries.opened()
            self._epoch = max(self._epoch, opened.epoch)
            self._outbox.rewind(opened.durability != Durability.DURABILITY_IN_MEMORY)
            if self._first is None:
                self._first = opened
                self._changed.fire()
            else:
                self.report.reconnects += 1
                self._catch_up(opened)
            await self._exchange(call)
        finally:
            call.cancel()

    async def _open(self, call: Any) -> None:
        # The first stream takes the server's next epoch; a later one must be above its own
        # predecessor, and not above that of another process that took over meanwhile.
        epoch = 0 if self._first is None else self._epoch + 1
        options = IngestOptions(
            lock_step=self._options.lock_step, omit_solve_summary=self._options.omit_solve_summary
        )
        open = IngestOpen(
            map_id=self._map_id, client_id=self._client_id, epoch=epoch, options=options
        )
        # Whether or not the server sees it: this epoch is spent.
        self._epoch = max(self._epoch, epoch)
        await _write(call, IngestRequest(open=open).SerializeToString())

    def _check_resumed(self, opened: IngestOpened) -> None:
        """Sees whether the server still has what it acknowledged."""
        if self._first is None:
            return
        if opened.map_uid != self._first.map_uid:
            raise errors.MapReplaced(self._map_id, self._first.map_uid, opened.map_uid)
        if opened.next_sequence <= self._outbox.released:
            raise errors.ItemsLost(opened.next_sequence, self._outbox.released)

    def _catch_up(self, opened: IngestOpened) -> None:
        """Takes the OPTIMIZED ack that the broken link may have lost: nobody sends it again."""
        if opened.optimized_sequence > self.report.optimized_through:
            self._take(
                IngestAck(
                    sequence=opened.optimized_sequence,
                    status=AckStatus.ACK_STATUS_OPTIMIZED,
                    revision=opened.revision,
                )
            )

    async def _exchange(self, call: Any) -> None:
        """Sends items and takes acks until the stream ends."""
        sender = asyncio.get_running_loop().create_task(self._send_all(call))
        try:
            while True:
                answer = await _read(call)
                if answer is None:
                    if self._is_closing and self._outbox.is_answered:
                        return
                    raise errors.broken(_RPC, "the stream ended early")
                event = answer.WhichOneof("event")
                if event == "ack":
                    self._take(answer.ack)
                elif event == "opened":
                    raise errors.Protocol(f"{_RPC}: the stream was opened twice")
        finally:
            await end(sender)

    async def _send_all(self, call: Any) -> None:
        while True:
            request = self._outbox.take_unsent()
            if request is not None:
                if not await _write(call, request):
                    # The transport takes no more: late acks and the reason come inbound.
                    return
            elif self._is_closing:
                # Half-closes; the server then answers what is outstanding and ends the stream.
                await _write(call, None)
                return
            else:
                await self._arrived.wait()

    def _take(self, ack: IngestAck) -> None:
        """Takes an ack."""
        sequence, status = ack.sequence, ack.status
        is_new = True
        if status in (AckStatus.ACK_STATUS_RECEIVED, AckStatus.ACK_STATUS_REJECTED):
            is_received = status == AckStatus.ACK_STATUS_RECEIVED
            outbox = self._outbox
            before = outbox.received(sequence) if is_received else outbox.rejected(sequence)
            if before is None:
                raise errors.Protocol(f"{_RPC}: an ack names an item that was not sent")
            is_new = not before.is_received
            if is_new and ack.duplicate and not before.was_resent:
                # An earlier session sent it, and was told of its solve.
                self._waiting["optimized"].pop(sequence, None)
        elif status == AckStatus.ACK_STATUS_DURABLE:
            self._outbox.durable(sequence)
        elif status != AckStatus.ACK_STATUS_OPTIMIZED:
            # A status that this client does not know.
            return
        self._retries.progress()
        if is_new:
            self._count(ack)
        if self._options.on_ack is not None:
            _call(self._options.on_ack, ack)
        self._changed.fire()

    def _count(self, ack: IngestAck) -> None:
        """Adds an ack that was not counted yet."""
        report, sequence = self.report, ack.sequence
        report.revision = max(report.revision, ack.revision)
        if ack.status == AckStatus.ACK_STATUS_RECEIVED:
            report.acknowledged += 1
            report.duplicates += ack.duplicate
            self._waiting["answer"].pop(sequence, None)
            self._declared.pop(sequence, None)
        elif ack.status == AckStatus.ACK_STATUS_REJECTED:
            self._reject(ack)
        elif ack.status == AckStatus.ACK_STATUS_DURABLE:
            report.durable_through = max(report.durable_through, sequence)
            _drop(self._waiting["durable"], sequence)
        else:
            report.optimized += 1
            report.optimized_through = max(report.optimized_through, sequence)
            report.failed_solves += ack.HasField("solve_failure")
            _drop(self._waiting["optimized"], sequence)

    def _reject(self, ack: IngestAck) -> None:
        violations = tuple(errors.violation(v) for v in ack.violations)
        item = RejectedItem(ack.sequence, violations)
        self.report.rejected += 1
        self.rejected.add(ack.sequence)
        if len(self.report.rejections) < KEPT_REJECTIONS:
            self.report.rejections.append(item)
        for waiting in self._waiting.values():
            waiting.pop(ack.sequence, None)
        declared = self._declared.pop(ack.sequence, None)
        if declared and self.on_dismissed is not None:
            self.on_dismissed(declared)
        if self._options.on_rejected is not None:
            _call(self._options.on_rejected, item)
        elif len(self.untold) < KEPT_REJECTIONS:
            self.untold.append(item)

    async def _explain(self, error: errors.CovisError) -> errors.CovisError:
        """Tells a fenced stream and a restarted server from other ends."""
        if not isinstance(error, errors.RpcError):
            return error
        if error.code == grpc.StatusCode.ABORTED:
            return errors.Fenced(self._map_id, self._client_id)
        if error.code == grpc.StatusCode.NOT_FOUND and self._first is not None:
            try:
                info = await self._link.unary_once(GetServerInfoRequest(), self._link.deadline_s)
            except errors.CovisError:
                return error
            if info.instance_id != self._instance_id:
                return errors.ServerRestarted(self._map_id, info.instance_id)
        return error


async def _read(call: Any) -> IngestResponse | None:
    """The next message; `None` where the stream ended with OK."""
    try:
        answer = await call.read()
    except grpc.aio.AioRpcError as error:
        raise errors.of_call(_RPC, error) from None
    return None if answer is grpc.aio.EOF else answer


async def _write(call: Any, request: bytes | None) -> bool:
    """Sends a message, or half-closes; false where the call has ended, whose reason is read."""
    try:
        await (call.done_writing() if request is None else call.write(request))
        return True
    except (grpc.aio.AioRpcError, asyncio.InvalidStateError):
        return False


def _drop(waiting: dict[int, None], through: int) -> None:
    """Takes out what is not above `through`."""
    for sequence in list(waiting):
        if sequence > through:
            break
        del waiting[sequence]


def _call(callback: Callable[[Any], None], argument: Any) -> None:
    """Calls the program's own function. Its errors are logged: the session goes on."""
    try:
        callback(argument)
    except Exception:
        _LOG.exception("a callback of the session failed")
