"""Files that go through streams: those of maps, and those that jobs take and make.

Paths of what is downloaded come from the server, so they are taken for what they are worth: relative, without
"..", and among those that the header announced. Chunks must be in order and without gaps.
"""

from __future__ import annotations

from collections.abc import AsyncIterator, Iterator
from pathlib import Path
from typing import IO, Any

from ._problems import choice
from .errors import Protocol
from .v1 import (
    DownloadJobFilesHeader,
    ExportMapHeader,
    FileChunk,
    ImportMapHeader,
    ImportMapRequest,
    MapFormat,
    UploadJobFilesHeader,
    UploadJobFilesRequest,
)

_CHUNK_BYTES = 256 * 1024
_COLMAP = ("cameras", "images", "points3D")


def format_number(value: str) -> int:
    """A format by its name, such as "colmap-binary"."""
    return choice(MapFormat, "MAP_FORMAT_", "format", value)


async def write(rpc: str, answers: AsyncIterator[Any], folder: Path) -> list[Path]:
    """Writes the files of a download below `folder`. Each gets its name when it is whole."""
    paths: list[str] | None = None
    written: list[Path] = []
    part: IO[bytes] | None = None
    try:
        async for answer in answers:
            if paths is None:
                if answer.WhichOneof("content") != "header":
                    raise Protocol(f"{rpc}: the files did not begin with a header")
                paths = _paths_of(answer.header)
                if not all(is_safe(path) for path in paths):
                    raise Protocol(f"{rpc}: a path leaves the folder of the files")
                continue
            chunk = answer.chunk
            begun = 0 if part is None else part.tell()
            next_path = paths[len(written)] if len(written) < len(paths) else None
            if chunk.path != next_path or chunk.offset != begun:
                raise Protocol(f"{rpc}: a chunk is out of order")
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
    if paths is None or len(written) != len(paths):
        raise Protocol(f"{rpc}: the files ended early")
    return written


def _paths_of(header: ExportMapHeader | DownloadJobFilesHeader) -> list[str]:
    if isinstance(header, ExportMapHeader):
        return list(header.paths)
    return [file.path for file in header.files]


def import_requests(header: ImportMapHeader, path: Path) -> Iterator[ImportMapRequest]:
    """The messages of an import: of one file, or of a folder with a COLMAP model."""
    files = [path]
    if path.is_dir():
        is_text = header.format == MapFormat.MAP_FORMAT_COLMAP_TEXT
        files = [path / f"{name}.{'txt' if is_text else 'bin'}" for name in _COLMAP]
    for file in files:
        if not file.is_file():
            raise FileNotFoundError(f"{file} is missing")
    yield ImportMapRequest(header=header)
    for chunk in _chunks([(file.name, file) for file in files]):
        yield ImportMapRequest(chunk=chunk)


def upload_requests(path: Path) -> Iterator[UploadJobFilesRequest]:
    """The messages of an upload: of one file, or of all files below a folder, by their names."""
    found = sorted(p for p in path.rglob("*") if p.is_file()) if path.is_dir() else [path]
    files = [(p.relative_to(path).as_posix() if p != path else p.name, p) for p in found]
    if not files:
        raise FileNotFoundError(f"{path} holds no file")
    size = sum(file.stat().st_size for _, file in files)
    yield UploadJobFilesRequest(header=UploadJobFilesHeader(size_bytes=size))
    for chunk in _chunks(files):
        yield UploadJobFilesRequest(chunk=chunk)


def _chunks(files: list[tuple[str, Path]]) -> Iterator[FileChunk]:
    for name, file in files:
        with open(file, "rb") as source:
            offset, data = 0, source.read(_CHUNK_BYTES)
            while True:
                following = source.read(_CHUNK_BYTES)
                yield FileChunk(path=name, offset=offset, data=data, last_chunk=not following)
                if not following:
                    break
                offset, data = offset + len(data), following


def is_safe(path: str) -> bool:
    """Whether a path stays below its folder, on any system."""
    return not set(path) & set("\\:\0") and all(p not in ("", ".", "..") for p in path.split("/"))


def _unfinished(target: Path) -> Path:
    return target.with_name(target.name + ".part")
