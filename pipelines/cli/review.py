"""``ringmodal review``."""

from __future__ import annotations

import sys
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

from ema.core.errors import InputError
from ema.io.campaign.manifest import MANIFEST_NAME
from pipelines.cli import options as opt
from pipelines.cli.streams import Interrupted
from pipelines.cli.terminal import echo
from pipelines.storage.result_folder import MARKER

_NEEDED = "starlette", "uvicorn", "filelock"


def review(
    place: Annotated[Path, opt.argument("RESULT|CAMPAIGN|FOLDER", "What to look at.")],
    port: Annotated[int, opt.option("Port; 0 for a free one.", min=0, max=65535)] = 0,
    no_open: Annotated[bool, opt.flag("--no-open", "Do not open the browser.")] = False,
) -> None:
    """Review results in the browser: see the poles, decide, sign off.

    Needs the optional part review. The server answers this machine alone; Ctrl-C ends it. Every
    edit is on disk before it is shown, so that nothing is lost.

    Examples:
      ringmodal review results/tyre_7
      ringmodal review measurements/2026-11 --no-open
    """  # noqa: D406, D407 - a heading of the help
    if missing := [name for name in _NEEDED if find_spec(name) is None]:
        rule, remedy = "the review needs it", "Install it: pip install 'ringmodal[review]'"
        raise InputError("ringmodal review", f"{missing[0]} is not installed", rule, remedy)
    # Not above: an optional part, and slow to load.
    from pipelines.review.bench import Desk
    from pipelines.review.server import open_browser, serve

    if not place.is_dir():
        rule = "it is the folder of a result, of a campaign, or of several"
        raise InputError(str(place), "no folder", rule, "Name a folder")
    place = place.resolve()
    is_result, is_campaign = ((place / name).is_file() for name in (MARKER, MANIFEST_NAME))
    desk = Desk(place.parent if is_result else place)
    name = desk.name_of(place)
    page = f"/r/{name}" if is_result else f"/w/{name}" if is_campaign else "/"

    def announce(address: str, file: Path) -> None:
        echo(address)
        echo(f"open: {file}")
        sys.stdout.flush()  # for a program that waits for the address
        if not no_open:
            open_browser(file)

    with suppress(Interrupted):  # the usual end; every edit is in a draft already
        serve(desk, page, port, announce)
