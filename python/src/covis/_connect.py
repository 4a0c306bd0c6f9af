"""How a program begins: a connection to a server, or to one of its own.

Tokens come from an argument, a file or the environment, certificates from files.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import numpy.typing as npt

from ._client import Client
from ._items import camera as camera_message
from ._link import Credentials, Link, LinkOptions
from ._server import LocalServer
from .v1 import Camera


async def connect(
    url: str,
    token: str | None = None,
    *,
    token_file: str | os.PathLike[str] | None = None,
    ca: str | os.PathLike[str] | None = None,
    cert: str | os.PathLike[str] | None = None,
    key: str | os.PathLike[str] | None = None,
    link: LinkOptions = LinkOptions(),
) -> Client:
    """Connects to a server, for instance `https://maps.example:7411`.

    - `url`: also several, separated by commas, of servers that share maps. The first that answers is
      taken; calls, sessions and watches then follow to the server that has their map, and on to the next
      when a link breaks.
    - `token`: of the server's tokens, or a JSON Web Token. By default that of `token_file`, else of the
      variables `COVIS_TOKEN_FILE` and `COVIS_TOKEN`. It is never sent in plain text to another machine.
    - `ca`: file with the authorities (PEM) that are trusted instead of those that gRPC brings.
    - `cert`, `key`: the client's own certificate and key (PEM), for mutual TLS.

    Raises `InvalidUrl`, `InvalidToken`, `TokenInPlainText`, `Unreachable`.
    """
    if (cert is None) != (key is None):
        raise ValueError("cert and key belong together: one of them is missing")
    identity = None if cert is None or key is None else (_read(cert), _read(key))
    credentials = Credentials(
        token=_token(token, token_file),
        ca_pem=None if ca is None else _read(ca),
        identity_pem=identity,
    )
    found = Link(url, credentials, link)
    try:
        await found.check()
    except BaseException:
        await found.close()
        raise
    return Client(found)


async def local(
    data_dir: str | os.PathLike[str] | None = None,
    *,
    binary: str | None = None,
    arguments: Sequence[str] = (),
    link: LinkOptions = LinkOptions(),
) -> Client:
    """Starts a server of its own on a free port of this machine, and connects to it.

    It ends when the client is closed. Maps are kept in `data_dir`, by default in a folder that is
    removed at the end. The program is `binary`, else `$COVIS_BIN`, else `covis` from the PATH;
    `arguments` are further ones of `covis serve`. Raises `ServerFailed`.
    """
    server = LocalServer()
    await server.start(data_dir, binary, arguments)
    try:
        client = Client(Link(server.url, Credentials(), link), server)
        await client._link.check()
        return client
    except BaseException:
        await server.stop()
        raise


def camera(
    id: int,
    width: int,
    height: int,
    K: npt.ArrayLike,
    distortion: npt.ArrayLike | None = None,
    *,
    model: str = "pinhole",
) -> Camera:
    """A camera for `Client.solve_bundle` and `Client.localize`; arguments as of `Session.camera`."""
    return camera_message(id, width, height, K, distortion, model)


def _token(token: str | None, file: str | os.PathLike[str] | None) -> str | None:
    if token is not None:
        return token
    # A file that is named on purpose wins over a variable that may stand there for another server.
    file = file if file is not None else os.environ.get("COVIS_TOKEN_FILE") or None
    if file is not None:
        return Path(file).read_text()
    return os.environ.get("COVIS_TOKEN") or None


def _read(path: str | os.PathLike[str]) -> bytes:
    return Path(path).read_bytes()
