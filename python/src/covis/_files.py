"""Maps as files: what an export writes, and what an import reads.

Paths of an export come from the server, so they are taken for what they are worth: relative, without
"..", and among those that the header announced. Chunks must be in order and without gaps.
"""

from __future__ import annotations

from collections.abc import AsyncIterator, Iterator
from pathlib import Path
from typing import IO, Any

from ._problems import choice
from .errors import Protocol
from .v1 import FileChunk, ImportMapHeader, ImportMapRequest, MapFormat

_RPC = "ExportMap"
_CHUNK_BYTES = 256 * 1024
_COLMAP = ("cameras", "images", "points3D")


def format_number(value: str) -> int:
    """A format by its name, such as "colmap-binary"."""
    return choice(MapFormat, "MAP_FORMAT_", "format", value)


async def write(answers: AsyncIterator[Any], folder: Path) -> list[Path]:
    """Writes the files of an export below `folder`. Each gets its name when it is whole."""
    header = None
    written: list[Path] = []
    part: IO[bytes] | None = None
    try:
        async for answer in answers:
            if header is None:
                if answer.WhichOneof("content") != "header":
                    raise Protocol(f"{_RPC}: the export did not begin with a header")
                header = answer.header
                if not all(is_safe(path) for path in header.paths):
                    raise Protocol(f"{_RPC}: a path leaves the folder of the export")
                continue
            chunk = answer.chunk
            begun = 0 if part is None else part.tell()
            next_path = header.paths[len(written)] if len(written) < len(header.paths) else None
            if chunk.path != next_path or chunk.offset != begun:
                raise Protocol(f"{_RPC}: a chunk is out of order")
            target = folder.joinpath(*chunk.path.split("/"))
            if part is None:
                target.parent.mkdir(parents=True, exist_ok=True)
                part = open(_unfinished(target), "wb")
            part.write(chunk.data)
            if chunk.last_chunk:
                part.close()
                part = None
                _unfinished(target).replace(target)
                written.append(target)
    finally:
        if part is not None:
            part.close()
            Path(part.name).unlink(missing_ok=True)
    if header is None or len(written) != len(header.paths):
        raise Protocol(f"{_RPC}: the export ended early")
    return written


def requests(header: ImportMapHeader, path: Path) -> Iterator[ImportMapRequest]:
    """The messages of an import: of one file, or of a folder with a COLMAP model."""
    files = [path]
    if path.is_dir():
        is_text = header.format == MapFormat.MAP_FORMAT_COLMAP_TEXT
        files = [path / f"{name}.{'txt' if is_text else 'bin'}" for name in _COLMAP]
    for file in files:
        if not file.is_file():
            raise FileNotFoundError(f"{file} is missing")
    yield ImportMapRequest(header=header)
    for file in files:
        with open(file, "rb") as source:
            offset, data = 0, source.read(_CHUNK_BYTES)
            while True:
                following = source.read(_CHUNK_BYTES)
                chunk = FileChunk(path=file.name, offset=offset, data=data, last_chunk=not following)
                yield ImportMapRequest(chunk=chunk)
                if not following:
                    break
                offset, data = offset + len(data), following


def is_safe(path: str) -> bool:
    """Whether a path stays below its folder, on any system."""
    return not set(path) & set("\\:\0") and all(p not in ("", ".", "..") for p in path.split("/"))


def _unfinished(target: Path) -> Path:
    return target.with_name(target.name + ".part")
