"""A server of one's own: `covis serve` as a child process, for scripts, notebooks and tests.

It listens on a free port of the loopback, reads neither a configuration file nor variables of the
environment, and ends with the client.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import shutil
import signal
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
        self._process: asyncio.subprocess.Process | None = None
        self._folder: str | None = None
        self._reader: asyncio.Task[None] | None = None
        self._tail: list[str] = []

    async def start(
        self, data_dir: str | os.PathLike[str] | None, binary: str | None, arguments: Sequence[str]
    ) -> None:
        """Starts it and waits until its maps are open."""
        program = binary or os.environ.get("COVIS_BIN") or shutil.which("covis")
        if program is None:
            raise ServerFailed("there is no covis on the PATH, and COVIS_BIN is not set")
        program = os.path.abspath(program) if os.sep in program else program
        self._folder = tempfile.mkdtemp(prefix="covis-")
        kept = Path(data_dir).absolute() if data_dir is not None else Path(self._folder) / "maps"
        command = ["serve", "--listen", "127.0.0.1:0", "--data-dir", str(kept), *arguments]
        environment = {k: v for k, v in os.environ.items() if not k.startswith("COVIS_")}
        try:
            self._process = await asyncio.create_subprocess_exec(
                program,
                *command,
                cwd=self._folder,
                env=environment,
                stdin=asyncio.subprocess.DEVNULL,
                stdout=asyncio.subprocess.PIPE,
                stderr=asyncio.subprocess.PIPE,
                # Ctrl-C is for the program that started it, which then ends the server in order.
                start_new_session=True,
            )
        except OSError as error:
            self._remove()
            raise ServerFailed(f"cannot start {program}: {error}") from error
        self._reader = asyncio.get_running_loop().create_task(self._read_errors())
        try:
            self.url = await asyncio.wait_for(self._listening(), _START_S)
        except asyncio.TimeoutError:
            await self.stop()
            raise ServerFailed(f"{program} serve did not open its maps within {_START_S} s") from None
        except BaseException:
            await self.stop()
            raise

    async def stop(self) -> None:
        """Ends it as SIGTERM does: what it has accepted is kept."""
        process = self._process
        if process is not None and process.returncode is None:
            with contextlib.suppress(ProcessLookupError):
                process.send_signal(signal.SIGTERM)
            try:
                await asyncio.wait_for(process.wait(), _DRAIN_S)
            except asyncio.TimeoutError:
                process.kill()
                await process.wait()
        if self._reader is not None:
            await asyncio.wait([self._reader])
        self._remove()

    async def _listening(self) -> str:
        assert self._process is not None and self._process.stdout is not None
        while line := await self._process.stdout.readline():
            text = line.decode(errors="replace").strip()
            if text.startswith("listening on "):
                return text.removeprefix("listening on ")
        await self._process.wait()
        assert self._reader is not None
        await asyncio.wait([self._reader])
        raise ServerFailed("covis serve ended: " + " ".join(self._tail).strip())

    async def _read_errors(self) -> None:
        """Keeps the pipe of its log empty, and the last lines for an error."""
        assert self._process is not None and self._process.stderr is not None
        while line := await self._process.stderr.readline():
            self._tail = [*self._tail[-9:], line.decode(errors="replace").strip()]

    def _remove(self) -> None:
        if self._folder is not None:
            shutil.rmtree(self._folder, ignore_errors=True)
            self._folder = None
