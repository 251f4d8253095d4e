"""Start and end of the server: port, token, redirect file and browser."""

from __future__ import annotations

import os
import secrets
import socket
import tempfile
import webbrowser
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import uvicorn

from ema.core.errors import InputError
from pipelines.review.desk import Desk
from pipelines.review.server import application

HOST = "127.0.0.1"
_TOKEN_BYTES = 32
_PAGE = """<!doctype html>
<meta charset="utf-8"><meta http-equiv="refresh" content="0; url={address}#token={token}">
<title>ringmodal review</title><p>Opening ringmodal review …
"""


def serve(desk: Desk, page: str, port: int, announce: Callable[[str, Path], None]) -> None:
    """Serve until interrupted.

    Parameters
    ----------
    desk : Desk
    page : str
        Path of the page that is opened first.
    port : int
        0 for a free one.
    announce : callable
        Called with the address and the redirect file when requests are answered.
    """
    token = secrets.token_hex(_TOKEN_BYTES)
    with _listening(port) as listener:
        number = listener.getsockname()[1]
        address = f"http://{HOST}:{number}{page}"
        config = uvicorn.Config(
            application(desk, number, token),
            log_config=None,
            access_log=False,
            lifespan="off",
            ws="none",
            server_header=False,
            date_header=False,
            timeout_graceful_shutdown=1,
        )
        with _redirect(address, token) as file:
            try:
                _Server(config, lambda: announce(address, file), desk).run(sockets=[listener])
            finally:
                desk.close()


def open_browser(file: Path) -> None:
    """Open the redirect file; the token is in the file alone, in no argument."""
    webbrowser.open(file.as_uri())


class _Server(uvicorn.Server):
    """A server that says when it is ready, and ends its streams before it waits for their end."""

    def __init__(self, config: uvicorn.Config, ready: Callable[[], None], desk: Desk) -> None:
        super().__init__(config)
        self._ready, self._desk = ready, desk

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets)
        self._ready()

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        self._desk.tell(None)
        await super().shutdown(sockets)


@contextmanager
def _listening(port: int) -> Iterator[socket.socket]:
    with socket.socket() as listener:
        try:
            listener.bind((HOST, port))
        except OSError as error:
            rule, remedy = "the port must be free", "Leave out --port"
            raise InputError("--port", f"{port}: {error.strerror}", rule, remedy) from error
        listener.listen()
        yield listener


@contextmanager
def _redirect(address: str, token: str) -> Iterator[Path]:
    """A file that only this user can read, whose page leads to the server with the token."""
    with tempfile.TemporaryDirectory(prefix="ringmodal-") as folder:
        path = Path(folder) / "open.html"
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(descriptor, "w", encoding="utf-8") as file:
            file.write(_PAGE.format(address=address, token=token))
        yield path
