"""Real servers for the tests: `covis serve` from `$COVIS_BIN`, else from the PATH, on free loopback ports."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import covis
import pytest
from proxy import Proxy

GUARD_S = 30.0
"""Longer than anything takes: a test that hangs ends with an error."""


class Server:
    """A server process on a folder, which can be killed and started again."""

    def __init__(self, folder: Path, *arguments: str, in_memory: bool = False) -> None:
        kept = ["--in-memory"] if in_memory else ["--data-dir", str(folder / "maps")]
        program = os.environ.get("COVIS_BIN") or shutil.which("covis")
        assert program, "set COVIS_BIN to a covis binary, or have one on the PATH"
        self._command = [os.path.abspath(program), "serve", "--listen", "127.0.0.1:0", *kept, *arguments]
        self._folder = folder
        self._log = folder / "server.log"
        self.start()

    def start(self) -> None:
        environment = {k: v for k, v in os.environ.items() if not k.startswith("COVIS_")}
        with open(self._log, "ab") as log:
            self._process = subprocess.Popen(
                self._command, cwd=self._folder, env=environment, stdout=subprocess.PIPE, stderr=log,
                text=True,
            )
        assert self._process.stdout is not None
        line = self._process.stdout.readline().strip()
        assert line.startswith("listening on "), self._log.read_text()
        self.url = line.removeprefix("listening on ")
        self.port = int(self.url.rpartition(":")[2])

    def kill(self) -> None:
        """As a loss of power ends a process."""
        self._end(signal.SIGKILL)

    def stop(self) -> None:
        self._end(signal.SIGTERM)

    def _end(self, how: signal.Signals) -> None:
        self._process.send_signal(how)
        self._process.wait(GUARD_S)
        assert self._process.stdout is not None
        self._process.stdout.close()


@pytest.fixture
def server(tmp_path: Path) -> Iterator[Server]:
    running = Server(tmp_path)
    yield running
    running.stop()


@pytest.fixture
def connect() -> Callable[..., covis.Client]:
    """Connects the client that the outage scenarios are about; cpp/tests puts the one in C++ here."""
    return covis.connect


@pytest.fixture
def client(server: Server) -> Iterator[covis.Client]:
    """A client past any proxy."""
    with covis.connect(server.url) as connected:
        yield connected


@pytest.fixture
def proxy(server: Server) -> Iterator[Proxy]:
    """A link to the server that can be cut."""
    with Proxy(server.port) as running:
        yield running


@pytest.fixture
def linked(proxy: Proxy, connect: Callable[..., covis.Client]) -> Iterator[covis.Client]:
    """A client whose link can be cut."""
    with connect(proxy.url) as connected:
        yield connected
