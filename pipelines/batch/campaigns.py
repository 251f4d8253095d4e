"""Campaigns under a folder: which there are, what they are called, where their results go."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from ema.core.errors import InputError
from ema.io.campaign.manifest import MANIFEST_NAME
from ema.io.formats import is_recording
from pipelines.batch.state import CAMPAIGNS
from pipelines.storage.result_folder import MARKER

_OF_RESULTS = {MARKER, CAMPAIGNS}  # folders with these hold results, not recordings
_JOINT = "+"


@dataclass(frozen=True)
class CampaignFolder:
    """A folder that is to be processed.

    Parameters
    ----------
    name : str
        Its path under the root, with slashes.
    place : str
        Path of its result under the results; no campaign's lies within another's.
    path : Path
        Absolute.
    """

    name: str
    place: str
    path: Path


def find_campaigns(root: Path, out: Path) -> tuple[CampaignFolder, ...]:
    """Find every campaign under a folder, at any depth, in the order of their names.

    A folder with a manifest is a campaign. So is one with recordings alone, unless it belongs to a
    campaign above it or holds one: a campaign whose manifest got lost is to be noticed. Links are
    followed, each folder once. Hidden folders and results are passed over.

    Parameters
    ----------
    root : Path
        May be a campaign itself.
    out : Path
        Where the batch writes; not searched.

    Raises
    ------
    InputError
        If there are none, or two would write to the same place.
    """
    if not root.is_dir():
        found = "a file" if root.exists() else "nothing there"
        rule = "a batch takes the campaigns of a folder"
        raise InputError(str(root), found, rule, "Check the path")
    top = Path(os.path.realpath(root))
    paths = list(_campaigns(top, {_identity(out)}, inside=False))
    if not paths:
        rule = f"a campaign is a folder with a {MANIFEST_NAME}"
        remedy = "Check the path, or draft manifests with `ringmodal init FOLDER`"
        raise InputError(str(root), "no campaigns", rule, remedy)
    origin = top.parent if top in paths else top
    names = sorted(path.relative_to(origin).as_posix() for path in paths)
    return tuple(placed(names, origin))


def _campaigns(folder: Path, seen: set[tuple[int, int] | None], *, inside: bool) -> Iterator[Path]:
    """Campaigns in and under `folder`, unless it was `seen`, whatever link leads to it now.

    Recordings `inside` a campaign are its own.
    """
    identity = _identity(folder)
    if identity in seen:
        return
    seen.add(identity)
    try:
        entries = sorted(folder.iterdir(), key=lambda path: (path.is_symlink(), path.name))
    except OSError:
        yield folder  # processing it will say what is wrong with it
        return
    names = {path.name for path in entries}
    is_campaign = MANIFEST_NAME in names
    if names & _OF_RESULTS and not is_campaign:
        return
    if is_campaign:
        yield folder
    below = False
    for entry in entries:
        if not entry.name.startswith(".") and os.path.isdir(entry):  # noqa: PTH112 - never raises
            for path in _campaigns(entry, seen, inside=inside or is_campaign):
                below = True
                yield path
    if not (is_campaign or inside or below) and any(map(_is_visible_recording, entries)):
        yield folder


def placed(names: list[str], origin: Path) -> Iterator[CampaignFolder]:
    """Give each campaign a place; one within another goes beside it, as a result is one folder."""
    places: dict[str, str] = {}
    for name in names:
        above = next((each for each in Path(name).parents if each.as_posix() in places), None)
        place = name
        if above is not None:
            within = Path(name).relative_to(above).parts
            place = _JOINT.join([places[above.as_posix()], *within])
        if place in places.values():
            rule = f"the result of another campaign goes to {place}, too"
            raise InputError(str(origin / name), "an ambiguous name", rule, "Rename the folder")
        places[name] = place
        yield CampaignFolder(name, place, origin / name)


def _is_visible_recording(path: Path) -> bool:
    return not path.name.startswith(".") and is_recording(path)


def _identity(path: Path) -> tuple[int, int] | None:
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_dev, status.st_ino
