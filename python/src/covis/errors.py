"""What can go wrong between a program and its server, and what may be tried again.

A status that the server built carries an `ErrorInfo` of domain "covis"; one without comes from the
transport, whose codes for a broken link vary (docs/wire.md, "Errors"). Whether a call may be repeated
is decided here and nowhere else.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import grpc
from google.rpc import error_details_pb2, status_pb2

from .v1 import IngestRequest, ItemViolation, Job, ViolationReason

_DOMAIN = "covis"
_DETAILS = "grpc-status-details-bin"


@dataclass(frozen=True)
class Violation:
    """A field that the server refuses."""

    field: str
    """Path from the request, for instance `keyframe.observations[3].pixel.x`."""
    description: str
    """For people."""
    reason: str
    """For programs, for instance `NOT_FINITE`; see `ViolationReason` in docs/wire.md."""

    def __str__(self) -> str:
        return f"{self.field}: {self.description} ({self.reason})"


@dataclass(frozen=True)
class RejectedItem:
    """An item that the server refused for good."""

    sequence: int
    violations: tuple[Violation, ...]


class CovisError(Exception):
    """Base of all errors of this package."""

    unanswered: tuple[IngestRequest, ...] = ()
    """`Session.unanswered` of the session that ended with this error."""

    @property
    def violations(self) -> tuple[Violation, ...]:
        """The fields that the server refused; empty for other errors."""
        return ()


class InvalidUrl(CovisError, ValueError):
    """The server's address is no URL."""

    def __init__(self, url: str) -> None:
        super().__init__(f"{url!r} is not the URL of a server, such as http://127.0.0.1:7411")


class InvalidToken(CovisError, ValueError):
    """A token that is empty or does not fit a header. It is not shown."""

    def __init__(self) -> None:
        super().__init__("the token is empty or not one line of ASCII")


class TokenInPlainText(CovisError):
    """A token that others on the network could read; nothing was sent."""

    def __init__(self, url: str) -> None:
        super().__init__(f"a token is not sent in plain text to {url}: use https")


class Unreachable(CovisError, ConnectionError):
    """No server answers at the address."""

    def __init__(self, url: str, details: str) -> None:
        super().__init__(f"no server answers at {url}: {details}")
        self.url = url


class ServerFailed(CovisError):
    """A server that this package started did not come up."""


class Protocol(CovisError):
    """An answer that the wire does not allow."""


class TooLarge(CovisError, ValueError):
    """An item that the server would not take because of its size; nothing was sent."""

    def __init__(self, size: int, limit: int) -> None:
        super().__init__(f"the item has {size} bytes, and the server accepts messages of at most {limit}")
        self.size = size
        self.limit = limit


class SequenceOrder(CovisError, ValueError):
    """A sequence that is not above the one before; nothing was sent."""

    def __init__(self, sequence: int, last: int) -> None:
        super().__init__(f"sequence {sequence} is not above {last}")


class Rejected(CovisError):
    """The server refused items for good. The session goes on."""

    def __init__(self, items: list[RejectedItem]) -> None:
        first = items[0]
        text = f"item {first.sequence} was rejected: " + "; ".join(map(str, first.violations))
        super().__init__(text + (f" (and {len(items) - 1} more)" if len(items) > 1 else ""))
        self.items = items

    @property
    def sequence(self) -> int:
        """The sequence of the first one."""
        return self.items[0].sequence

    @property
    def violations(self) -> tuple[Violation, ...]:
        """What is wrong with the first one."""
        return self.items[0].violations


class NotDurable(CovisError):
    """The server keeps its journal in memory: nothing becomes durable."""

    def __init__(self) -> None:
        super().__init__("the server keeps maps in memory only, so that nothing becomes durable")


class Fenced(CovisError):
    """A newer stream of the same client took over."""

    def __init__(self, map_id: str, client_id: str) -> None:
        super().__init__(f"another stream of client {client_id} on map {map_id} has taken over")


class MapReplaced(CovisError):
    """The map was deleted and made again while the session was open."""

    def __init__(self, map_id: str, expected: str, uid: str) -> None:
        super().__init__(f"map {map_id} is not the same map as before (uid {uid}, was {expected})")


class ServerRestarted(CovisError):
    """The server was started anew and no longer has the map: its journal was in memory."""

    def __init__(self, map_id: str, instance_id: str) -> None:
        super().__init__(
            f"the server was restarted (instance {instance_id}) and has no map {map_id} any more"
        )


class MapNotOpen(CovisError):
    """A map that does not settle, because it takes no changes: its work waits."""

    def __init__(self, map_id: str, state: str) -> None:
        super().__init__(f"map {map_id} is {state}: its remaining work waits until it is open")
        self.state = state
        """"frozen" or "poisoned"."""


class ItemsLost(CovisError):
    """The server no longer has items that it had acknowledged."""

    def __init__(self, next_sequence: int, acknowledged: int) -> None:
        super().__init__(
            f"the server lost items: it continues at {next_sequence}, but {acknowledged} was acknowledged"
        )


class RetriesExhausted(CovisError, ConnectionError):
    """The link did not come back within the retries. `__cause__` is what the last attempt ended with.

    `unanswered` has the items that the session had no answer to.
    """

    def __init__(self, attempts: int, last: CovisError) -> None:
        super().__init__(f"gave up after {attempts} attempts: {last}")
        self.attempts = attempts
        self.__cause__ = last


class JobFailed(CovisError):
    """A job ended badly; `job.failure` says why."""

    def __init__(self, job: Job) -> None:
        super().__init__(f"job {job.job_id} failed: {job.failure.message} ({job.failure.reason})")
        self.job = job


class Closed(CovisError):
    """The session or the watch has ended."""

    def __init__(self) -> None:
        super().__init__("the session has ended")


class RpcError(CovisError):
    """The server, or the link to it, ended a call."""

    def __init__(self, rpc: str, error: grpc.aio.AioRpcError | None, text: str = "") -> None:
        self.rpc = rpc
        """The call, for instance `CreateMap`."""
        self.code: grpc.StatusCode = error.code() if error else grpc.StatusCode.UNAVAILABLE
        """What it ended with."""
        self.message = (error.details() if error else None) or text
        self.reason: str | None = None
        """`ErrorInfo.reason` of a status that the server built, for instance `MAP_NOT_FOUND`."""
        self.metadata: dict[str, str] = {}
        """Values by name, for instance `map_id` and `limit`."""
        self.retry_after_s: float | None = None
        """How long the server asks to wait before the next attempt."""
        self._violations: tuple[Violation, ...] = ()
        for key, value in (error.trailing_metadata() or ()) if error else ():
            if key == _DETAILS and isinstance(value, bytes):
                self._read(value)
        violations = self.violations
        named = [str(one) for one in violations if one.field not in self.message]
        super().__init__(f"{rpc}: {'; '.join([self.message, *named])} ({self.code.name})")

    @property
    def violations(self) -> tuple[Violation, ...]:
        """The fields that are wrong."""
        return self._violations

    @property
    def owner(self) -> str | None:
        """The URL of the server that has the map, where the one that was asked does not."""
        return self.metadata.get("owner") if self.reason == "MAP_OWNED_ELSEWHERE" else None

    @property
    def is_transient(self) -> bool:
        """Whether trying again may help: the link broke, or the server is full or shutting down."""
        codes = grpc.StatusCode
        if self.reason is not None:
            return self.code in (codes.UNAVAILABLE, codes.RESOURCE_EXHAUSTED)
        return self.code in (codes.UNAVAILABLE, codes.UNKNOWN, codes.INTERNAL, codes.CANCELLED)

    def _read(self, details: bytes) -> None:
        for packed in status_pb2.Status.FromString(details).details:
            message: Any
            if packed.Unpack(message := error_details_pb2.ErrorInfo()) and message.domain == _DOMAIN:
                self.reason = message.reason
                self.metadata = dict(message.metadata)
            elif packed.Unpack(message := error_details_pb2.BadRequest()):
                fields = list(message.field_violations)
                self._violations = tuple(Violation(f.field, f.description, f.reason) for f in fields)
            elif packed.Unpack(message := error_details_pb2.RetryInfo()):
                delay = message.retry_delay
                self.retry_after_s = delay.seconds + delay.nanos * 1e-9


class InvalidArgument(RpcError, ValueError):
    """INVALID_ARGUMENT: `violations` names the fields."""


class NotFound(RpcError, LookupError):
    """NOT_FOUND: no such map, client or job."""


class AlreadyExists(RpcError):
    """ALREADY_EXISTS: the id is taken."""


class FailedPrecondition(RpcError):
    """FAILED_PRECONDITION: the map is frozen or poisoned, or holds nothing that can be solved."""


class ResourceExhausted(RpcError):
    """RESOURCE_EXHAUSTED: a limit; `metadata["limit"]` names it."""


class Unauthenticated(RpcError, PermissionError):
    """UNAUTHENTICATED: no token, or one that the server does not know."""


class PermissionDenied(RpcError, PermissionError):
    """PERMISSION_DENIED: the token's role does not cover the call."""


class DeadlineExceeded(RpcError, TimeoutError):
    """DEADLINE_EXCEEDED: there was no answer in time."""


_CLASSES: dict[grpc.StatusCode, type[RpcError]] = {
    grpc.StatusCode.INVALID_ARGUMENT: InvalidArgument,
    grpc.StatusCode.NOT_FOUND: NotFound,
    grpc.StatusCode.ALREADY_EXISTS: AlreadyExists,
    grpc.StatusCode.FAILED_PRECONDITION: FailedPrecondition,
    grpc.StatusCode.RESOURCE_EXHAUSTED: ResourceExhausted,
    grpc.StatusCode.UNAUTHENTICATED: Unauthenticated,
    grpc.StatusCode.PERMISSION_DENIED: PermissionDenied,
    grpc.StatusCode.DEADLINE_EXCEEDED: DeadlineExceeded,
}


def of_call(rpc: str, error: grpc.aio.AioRpcError) -> RpcError:
    """The error that `rpc` ended with."""
    return _CLASSES.get(error.code(), RpcError)(rpc, error)


def broken(rpc: str, text: str) -> RpcError:
    """A link that went away without a status."""
    return RpcError(rpc, None, text)


def is_transient(error: CovisError) -> bool:
    """Whether trying again may help."""
    return isinstance(error, Unreachable) or (isinstance(error, RpcError) and error.is_transient)


_NOT_BEGUN = ("STARTING", "MAP_MOVING", "MAP_OWNED_ELSEWHERE")
"""Reasons of UNAVAILABLE with which nothing of the call was done."""
_HARMLESS = ("Get", "List", "Localize", "RefinePose", "Solve", "CreateJob")
"""How calls begin that change nothing, or nothing when they are made again."""


def may_repeat(error: RpcError) -> bool:
    """Whether a call with one answer may be made again: the server or the link was not there
    (UNAVAILABLE), and the server says that it did nothing of the call, or the call changes nothing."""
    if error.code != grpc.StatusCode.UNAVAILABLE:
        return False
    return error.reason in _NOT_BEGUN or error.rpc.startswith(_HARMLESS)


def violation(message: ItemViolation) -> Violation:
    """A violation of an ack."""
    known = message.reason in ViolationReason.values()
    name = ViolationReason.Name(message.reason) if known else str(message.reason)
    return Violation(message.field, message.description, name.removeprefix("VIOLATION_REASON_"))
