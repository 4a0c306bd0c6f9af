"""The connection to a server: where it leads, what each call carries, and the calls by their names.

Several servers may share maps. A link that is given the URLs of some goes to the first that answers. A
server that does not serve a map names the one that does (MAP_OWNED_ELSEWHERE): the link then goes there.
When it breaks it goes back to the server that named the owner, and from there to the next of the URLs that
it was given. With one URL it stays there.

Calls are described by the descriptors of the services, so that no code is generated for them. Secrets
show in no `repr`. This file knows gRPC and no message.
"""

from __future__ import annotations

import asyncio
import copy
import dataclasses
import ipaddress
import itertools
from collections.abc import AsyncIterator, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import urlsplit

import grpc
import grpc.aio
from google.protobuf.message import Message
from google.protobuf.message_factory import GetMessageClass

from . import errors
from ._retry import Retries, RetryPolicy
from .v1 import (
    ingest_service_pb2,
    job_service_pb2,
    map_service_pb2,
    optimization_service_pb2,
    server_service_pb2,
)

_MOST_FOLLOWED = 4
"""How often a call follows from server to server before it fails."""

_MAX_ANSWER_BYTES = 256 * 1024 * 1024

_FILES = (
    ingest_service_pb2,
    job_service_pb2,
    map_service_pb2,
    optimization_service_pb2,
    server_service_pb2,
)
METHODS: dict[str, Any] = {
    method.input_type.full_name: method
    for file in _FILES
    for service in file.DESCRIPTOR.services_by_name.values()
    for method in service.methods
}
"""Each method by the name of its request."""


@dataclass(frozen=True)
class LinkOptions:
    """Times of a link, and how it is used."""

    connect_timeout_s: float = 10.0
    """How long a connection may take to stand."""
    keep_alive_s: float = 10.0
    """A connection is probed (HTTP/2 PING) after so long without a word from the server."""
    keep_alive_timeout_s: float = 10.0
    """It is given up when a probe is not answered for so long."""
    deadline_s: float = 30.0
    """How long a call with one answer may take, those that solve left out."""
    compress: bool = False
    """Messages travel compressed (gzip), for links that are slow."""
    retry: RetryPolicy = RetryPolicy()
    """How often a call with one answer is made again, within its deadline: see `errors.may_repeat`."""

    def _channel_options(self, is_loopback: bool) -> list[tuple[str, int]]:
        options = [
            ("grpc.max_receive_message_length", _MAX_ANSWER_BYTES),
            ("grpc.max_send_message_length", -1),
            ("grpc.keepalive_time_ms", round(self.keep_alive_s * 1000)),
            ("grpc.keepalive_timeout_ms", round(self.keep_alive_timeout_s * 1000)),
            # A ping that measures the link may be under way when it breaks; it is given up as soon.
            ("grpc.http2.ping_timeout_ms", round(self.keep_alive_timeout_s * 1000)),
            ("grpc.keepalive_permit_without_calls", 1),
            ("grpc.http2.max_pings_without_data", 0),
            # The retries of sessions decide how long to wait; the channel itself waits shortly.
            ("grpc.initial_reconnect_backoff_ms", 100),
            ("grpc.min_reconnect_backoff_ms", round(self.connect_timeout_s * 1000)),
            ("grpc.max_reconnect_backoff_ms", 1000),
            # Clients of one process do not share connections, so that closing one ends its own.
            ("grpc.use_local_subchannel_pool", 1),
        ]
        if is_loopback:
            options.append(("grpc.enable_http_proxy", 0))
        return options


@dataclass(frozen=True)
class Credentials:
    """What a client shows, and whom it trusts."""

    token: str | None = field(default=None, repr=False)
    ca_pem: bytes | None = field(default=None, repr=False)
    identity_pem: tuple[bytes, bytes] | None = field(default=None, repr=False)
    """The client's certificate chain and private key."""


class _Server:
    """One server, to which calls go with the token."""

    def __init__(self, url: str, credentials: Credentials, options: LinkOptions) -> None:
        self.url = url
        scheme, host, port = _split(url)
        self.metadata = _metadata(url, scheme, host, credentials.token)
        target = f"[{host}]:{port}" if ":" in host else f"{host}:{port}"
        settings = options._channel_options(_is_loopback(host))
        compression = grpc.Compression.Gzip if options.compress else None
        if scheme == "https":
            chain, key = credentials.identity_pem or (None, None)
            tls = grpc.ssl_channel_credentials(credentials.ca_pem, key, chain)
            self.channel = grpc.aio.secure_channel(target, tls, settings, compression)
        else:
            self.channel = grpc.aio.insecure_channel(target, settings, compression)

    async def check(self, timeout: float) -> None:
        """Sees whether somebody answers: the call of the health service, which is open to everybody."""
        call = self.channel.unary_unary("/grpc.health.v1.Health/Check")
        try:
            await call(b"", timeout=timeout)
        except grpc.aio.AioRpcError as error:
            failure = errors.of_call("Check", error)
            codes = (grpc.StatusCode.UNAVAILABLE, grpc.StatusCode.DEADLINE_EXCEEDED)
            if failure.reason is None and failure.code in codes:
                raise errors.Unreachable(self.url, failure.message) from error


class _Servers:
    """Those that a link and those apart from it have been at, each with one channel."""

    def __init__(self, credentials: Credentials, options: LinkOptions) -> None:
        self._credentials = credentials
        self._options = options
        self._by_url: dict[str, _Server] = {}

    def at(self, url: str) -> _Server:
        """The server at a URL. Raises `InvalidUrl`, `InvalidToken`, `TokenInPlainText`."""
        if url not in self._by_url:
            self._by_url[url] = _Server(url, self._credentials, self._options)
        return self._by_url[url]

    async def close(self) -> None:
        await asyncio.gather(*(server.channel.close() for server in self._by_url.values()))


class Link:
    """Where calls go, of all the servers that there may be; `urls` are separated by commas."""

    def __init__(self, urls: str, credentials: Credentials, options: LinkOptions) -> None:
        self._deadline = options.deadline_s
        self._retry = options.retry
        self._timeout = options.connect_timeout_s
        self._given = [url.strip() for url in urls.split(",")]
        self._servers = _Servers(credentials, options)
        self._place = 0
        self._at = [self._servers.at(url) for url in self._given][0]

    @property
    def url(self) -> str:
        """The address that calls go to."""
        return self._at.url

    @property
    def deadline_s(self) -> float:
        """How long a call with one answer may take, those that solve left out."""
        return self._deadline

    def apart(self) -> Link:
        """One that goes its own ways from here on, for what follows one map."""
        return copy.copy(self)

    def follow(self, error: errors.CovisError) -> bool:
        """Goes to the server that an error names, or, where the link broke or nobody serves the map, to
        the next one. Whether the error named the owner of a map, so that nothing of the call was done.
        """
        owner = error.owner if isinstance(error, errors.RpcError) else None
        if owner is not None:
            return self._go_to(owner, self._place)
        if errors.is_transient(error) and not isinstance(error, errors.ResourceExhausted):
            is_given = self._given[self._place] == self.url
            # Where an owner is gone, the server that named it may know the next one.
            place = (self._place + 1) % len(self._given) if is_given else self._place
            if not is_given or place != self._place:
                self._go_to(self._given[place], place)
        return False

    def _go_to(self, url: str, place: int) -> bool:
        """False where the URL or the credentials cannot be used there."""
        try:
            self._at = self._servers.at(url)
        except errors.CovisError:
            return False
        self._place = place
        return True

    async def check(self) -> None:
        """Goes to the first server that answers. Raises `Unreachable` of the first where none does."""
        nobody: errors.Unreachable | None = None
        for place, url in enumerate(self._given):
            self._go_to(url, place)
            try:
                return await self._at.check(self._timeout)
            except errors.Unreachable as error:
                nobody = nobody or error
        if nobody is not None:
            raise nobody

    async def close(self) -> None:
        """Ends all calls."""
        await self._servers.close()

    def raw_stream(self, request: Any, decode: Any) -> Any:
        """Begins a call of the method that takes `request`, with messages that are bytes already."""
        path = _path(METHODS[request.DESCRIPTOR.full_name])
        return self._at.channel.stream_stream(path, None, decode)(metadata=self._at.metadata)

    async def unary(
        self,
        request: Message,
        timeout: float | None = None,
        solves: bool = False,
        retry: RetryPolicy | None = None,
    ) -> Any:
        """Makes a call with one answer, and again where it may be repeated, by the link's retries."""
        if timeout is None and not solves:
            timeout = self._deadline
        policy = self._retry if retry is None else retry
        limits = [limit for limit in (policy.give_up_after_s, timeout) if limit is not None]
        retries = Retries(dataclasses.replace(policy, give_up_after_s=min(limits, default=None)))
        while True:
            try:
                return await self.unary_once(request, timeout)
            except errors.RpcError as error:
                if not errors.may_repeat(error):
                    raise
                try:
                    await retries.wait(error)
                except errors.RetriesExhausted:
                    raise error from None

    async def unary_once(self, request: Message, timeout: float | None) -> Any:
        """Makes a call with one answer, also for those who have retries of their own."""
        method = METHODS[request.DESCRIPTOR.full_name]
        decode = GetMessageClass(method.output_type).FromString
        for followed in itertools.count():
            call = self._at.channel.unary_unary(_path(method), _encode, decode)
            try:
                return await call(request, timeout=timeout, metadata=self._at.metadata)
            except grpc.aio.AioRpcError as error:
                failure = errors.of_call(method.name, error)
                if not self.follow(failure) or followed == _MOST_FOLLOWED:
                    raise failure from None

    async def answers(self, request: Message, timeout: float | None = None) -> AsyncIterator[Any]:
        """Makes a call with many answers. Closing the iterator cancels it."""
        method = METHODS[request.DESCRIPTOR.full_name]
        decode = GetMessageClass(method.output_type).FromString
        for followed in itertools.count():
            stub = self._at.channel.unary_stream(_path(method), _encode, decode)
            call = stub(request, timeout=timeout, metadata=self._at.metadata)
            try:
                async for answer in call:
                    yield answer
                return
            except grpc.aio.AioRpcError as error:
                failure = errors.of_call(method.name, error)
                # Where another server has the map there was no answer yet.
                if not self.follow(failure) or followed == _MOST_FOLLOWED:
                    raise failure from None
            finally:
                call.cancel()

    async def upload(self, requests: Iterable[Message], kind: type[Message]) -> Any:
        """Makes a call with many requests and one answer."""
        method = METHODS[kind.DESCRIPTOR.full_name]
        decode = GetMessageClass(method.output_type).FromString
        call = self._at.channel.stream_unary(_path(method), _encode, decode)
        failures: list[Exception] = []

        def guarded() -> Iterator[Message]:
            try:
                yield from requests
            except Exception as error:
                failures.append(error)
                raise

        try:
            return await call(guarded(), metadata=self._at.metadata)
        except grpc.aio.AioRpcError as error:
            failure = errors.of_call(method.name, error)
            # What was read of the requests is gone: the next call goes to the other server.
            self.follow(failure)
            raise failure from None
        except asyncio.CancelledError:
            # gRPC cancels a call whose requests cannot be made, and keeps the reason to itself.
            if failures:
                raise failures[0] from None
            raise


def _encode(message: Message) -> bytes:
    return message.SerializeToString()


def _path(method: Any) -> str:
    return f"/{method.containing_service.full_name}/{method.name}"


def _split(url: str) -> tuple[str, str, int]:
    """Scheme, host and port."""
    try:
        parts = urlsplit(url)
        scheme, host, port = parts.scheme, parts.hostname, parts.port
    except ValueError:
        raise errors.InvalidUrl(url) from None
    if scheme not in ("http", "https") or not host or parts.path not in ("", "/"):
        raise errors.InvalidUrl(url)
    return scheme, host, port or (443 if scheme == "https" else 80)


def _metadata(url: str, scheme: str, host: str, token: str | None) -> tuple[tuple[str, str], ...]:
    """What each call carries. A token never travels in plain text to another machine."""
    if token is None:
        return ()
    token = token.strip()
    if not token or not token.isascii() or not token.isprintable():
        raise errors.InvalidToken
    if scheme != "https" and not _is_loopback(host):
        raise errors.TokenInPlainText(url)
    return (("authorization", f"Bearer {token}"),)


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
