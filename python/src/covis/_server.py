"""A server of one's own: `covis serve` as a child process, for scripts, notebooks and tests.

It listens on a free port of the loopback, reads neither a configuration file nor variables of the
environment, and ends with the client, at the latest with the program.
"""

from __future__ import annotations

import asyncio
import atexit
import os
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path

from .errors import ServerFailed

_START_S = 30.0
_DRAIN_S = 15.0


class LocalServer:
    """The child process."""

    def __init__(self) -> None:
        self.url = ""
        self._process: subprocess.Popen[str] | None = None
        self._folder = Path()

    async def start(
        self, data_dir: str | os.PathLike[str] | None, binary: str | None, arguments: Sequence[str]
    ) -> None:
        """Starts it and waits until its maps are open."""
        program = binary or os.environ.get("COVIS_BIN") or shutil.which("covis")
        if program is None:
            raise ServerFailed("there is no covis on the PATH, and COVIS_BIN is not set")
        program = os.path.abspath(program) if os.sep in program else program
        self._folder = Path(tempfile.mkdtemp(prefix="covis-"))
        kept = self._folder / "maps" if data_dir is None else Path(data_dir).absolute()
        command = [program, "serve", "--listen", "127.0.0.1:0", "--data-dir", str(kept), *arguments]
        atexit.register(self._end)
        try:
            with open(self._log, "wb") as log:
                self._process = subprocess.Popen(
                    command,
                    cwd=self._folder,
                    env={k: v for k, v in os.environ.items() if not k.startswith("COVIS_")},
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.PIPE,
                    stderr=log,
                    text=True,
                    # Ctrl-C is for the program that started it, which then ends the server in order.
                    start_new_session=True,
                )
            self.url = await asyncio.wait_for(asyncio.to_thread(self._listening), _START_S)
        except BaseException as error:
            await self.stop()
            if isinstance(error, OSError):
                raise ServerFailed(f"cannot start {program}: {error}") from error
            if isinstance(error, asyncio.TimeoutError):
                text = f"{program} serve did not open its maps within {_START_S} s"
                raise ServerFailed(text) from None
            raise

    async def stop(self) -> None:
        """Ends it as SIGTERM does: what it has accepted is kept."""
        await asyncio.to_thread(self._end)

    @property
    def _log(self) -> Path:
        return self._folder / "server.log"

    def _listening(self) -> str:
        """Its first line tells the address."""
        assert self._process is not None and self._process.stdout is not None
        line = self._process.stdout.readline().strip()
        if line.startswith("listening on "):
            return line.removeprefix("listening on ")
        self._process.wait(_DRAIN_S)
        said = " ".join(self._log.read_text(errors="replace").split())
        raise ServerFailed(f"covis serve ended: {said}")

    def _end(self) -> None:
        atexit.unregister(self._end)
        process, self._process = self._process, None
        if process is not None:
            process.terminate()
            try:
                process.wait(_DRAIN_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
            if process.stdout is not None:
                process.stdout.close()
        shutil.rmtree(self._folder, ignore_errors=True)
