"""``ringmodal review``: the pages to see a result and decide on it.

Little is imported above: the browser comes while the rest is loaded.
"""

from __future__ import annotations

import gc
import os
import secrets
import sys
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ema.core.errors import InputError
from pipelines.cli.streams import Interrupted
from pipelines.cli.terminal import echo
from pipelines.storage.atomic import MARKER

if TYPE_CHECKING:
    from pipelines.review.answers import Office

_NEEDED = "starlette", "uvicorn", "filelock"
_NAME_BYTES = 6


def review(
    place: Annotated[
        Path, typer.Argument(metavar="RESULT|CAMPAIGN|FOLDER", help="What to look at.")
    ],
    port: Annotated[
        int, typer.Option(help="Port; 0 for a free one.", metavar="N", min=0, max=65535)
    ] = 0,
    no_open: Annotated[bool, typer.Option("--no-open", help="Do not open the browser.")] = False,
) -> None:
    """Review results in the browser: see the poles, decide, sign off.

    The server answers this machine alone; Ctrl-C ends it. Every edit is on disk before it is
    shown, so that nothing is lost.

    Examples:
      ringmodal review results/tyre_7
      ringmodal review measurements/2026-11 --no-open
    """  # noqa: D406, D407 - a heading of the help
    if missing := [name for name in _NEEDED if find_spec(name) is None]:
        rule, remedy = "the review needs it", f"Install it: pip install {' '.join(_NEEDED)}"
        raise InputError("ringmodal review", f"{missing[0]} is not installed", rule, remedy)
    if not place.is_dir():
        rule = "it is the folder of a result, of a campaign, or of several"
        raise InputError(str(place), "no folder", rule, "Name a folder")
    # Not above: an optional part.
    from pipelines.review.server import begun, open_browser, serve

    place, name = place.resolve(), secrets.token_hex(_NAME_BYTES)

    def announce(address: str, file: Path) -> None:
        echo(address)
        echo(f"open: {file}")
        sys.stdout.flush()  # for a program that waits for the address
        if not no_open:
            open_browser(file)

    office = begun(lambda: _opened(place, name))
    with suppress(Interrupted):  # the usual end; every edit is in a draft already
        # Of a result the page is known before the rest is loaded.
        page = f"/r/{name}" if (place / MARKER).is_file() else office.result().page(name)
        serve(office, page, port, announce)
    if not office.done() or office.result().is_busy:
        sys.stdout.flush()
        os._exit(0)  # an interpreter that ends under a thread in compiled code is aborted


def _opened(place: Path, name: str) -> Office:
    gc.disable()  # nothing that is loaded is garbage
    # Not above: it takes as long as the browser and the page need to come.
    from pipelines.review.answers import Office

    gc.freeze()
    gc.enable()
    return Office.opened(place, name)
