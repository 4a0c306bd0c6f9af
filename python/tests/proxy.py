"""A link that can be cut, held, frozen and led elsewhere: a TCP relay between a client and a server.

Cutting drops every connection, at once or after an exact number of bytes; holding keeps what the server
sends from the client; closed, it drops new connections as they come; frozen, its present connections
swallow all bytes and never close, as if the other end had lost its power. Everything is by command,
nothing by time.
"""

from __future__ import annotations

import socket
import threading
from types import TracebackType

REQUESTS, ANSWERS = "requests", "answers"


class Proxy:
    def __init__(self, target: int) -> None:
        self._target = target
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.url = f"http://127.0.0.1:{self._listener.getsockname()[1]}"
        self._changed = threading.Condition()
        self._pairs: list[_Pair] = []
        self._is_held = False
        self._is_closed = False
        self._is_over = False
        self.passed = {REQUESTS: 0, ANSWERS: 0}
        """Bytes that went through, in each direction."""
        self._cut_at: tuple[str, int] | None = None
        self._threads = [threading.Thread(target=self._accept)]
        self._threads[0].start()

    def __enter__(self) -> Proxy:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with self._changed:
            self._is_over = True
            self._changed.notify_all()
        self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        self.cut()
        for thread in self._threads:
            thread.join()

    def cut(self) -> None:
        """Drops all connections; new ones are taken."""
        with self._changed:
            pairs, self._pairs = self._pairs, []
            for pair in pairs:
                pair.drop()
            self._changed.notify_all()

    def cut_after(self, direction: str, count: int) -> None:
        """Drops all connections once exactly so many bytes have gone through from now on."""
        with self._changed:
            self._cut_at = (direction, self.passed[direction] + count)

    def hold(self, is_held: bool) -> None:
        """Keeps answers from the client, or lets them through again."""
        with self._changed:
            self._is_held = is_held
            self._changed.notify_all()

    def freeze(self) -> None:
        """Has the present connections swallow all bytes, and neither end be told."""
        with self._changed:
            for pair in self._pairs:
                pair.is_frozen = True

    def close(self) -> None:
        """Drops new connections as they come."""
        with self._changed:
            self._is_closed = True

    def lead_to(self, target: int) -> None:
        """Leads new connections to another server."""
        with self._changed:
            self._target = target

    def _accept(self) -> None:
        while True:
            try:
                client, _ = self._listener.accept()
            except OSError:
                return
            with self._changed:
                if self._is_closed or self._is_over:
                    client.close()
                    continue
                try:
                    server = socket.create_connection(("127.0.0.1", self._target))
                except OSError:
                    client.close()
                    continue
                for end in (client, server):
                    end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                pair = _Pair(client, server)
                self._pairs.append(pair)
            for direction in (REQUESTS, ANSWERS):
                thread = threading.Thread(target=self._relay, args=(pair, direction))
                thread.start()
                self._threads.append(thread)

    def _relay(self, pair: _Pair, direction: str) -> None:
        ends = (pair.client, pair.server)
        source, sink = ends if direction == REQUESTS else ends[::-1]
        while True:
            try:
                data = source.recv(1 << 16)
            except OSError:
                data = b""
            with self._changed:
                if direction == ANSWERS:
                    self._changed.wait_for(lambda: not self._is_held or pair.is_dropped)
                if pair.is_dropped:
                    return
                if pair.is_frozen:
                    if data:
                        continue
                    # The end of one side does not reach the other.
                    self._changed.wait_for(lambda: pair.is_dropped)
                    return
                is_last = not data
                if self._cut_at is not None and self._cut_at[0] == direction:
                    left = self._cut_at[1] - self.passed[direction]
                    is_last |= len(data) >= left
                    data = data[:left]
                self.passed[direction] += len(data)
            try:
                sink.sendall(data)
            except OSError:
                is_last = True
            if is_last:
                with self._changed:
                    if self._cut_at is not None and self.passed[direction] >= self._cut_at[1]:
                        self._cut_at = None
                    pair.drop()
                    if pair in self._pairs:
                        self._pairs.remove(pair)
                    self._changed.notify_all()
                return


class _Pair:
    """The two connections of one link."""

    def __init__(self, client: socket.socket, server: socket.socket) -> None:
        self.client = client
        self.server = server
        self.is_frozen = False
        self.is_dropped = False

    def drop(self) -> None:
        self.is_dropped = True
        for end in (self.client, self.server):
            try:
                end.shutdown(socket.SHUT_RDWR)
            except OSError:
                pass
            end.close()
