"""A first ``campaign.toml`` for a folder of recordings, as far as the files themselves tell."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ema.errors import InputError
from ema.io.formats import is_recording, read_file
from ema.io.manifest import MANIFEST_NAME
from ema.recording import ACCELERATION, FORCE, Channel, Recording

# A reference sensor keeps one name and sits on no node of the grid, or on the same in all runs.
_REFERENCE_WORD = "ref"
_PROBABLE_GRIDS = (72, 36, 48, 60, 90, 120, 180, 360)
_TO_FILL_IN = """\
# Draft made from the recordings. Fill in what stands in angle brackets, check the rest, and
# uncomment what applies; every key is explained in docs/conventions.md and the README.
"""


@dataclass(frozen=True)
class Draft:
    """A draft manifest and what is still missing in it.

    Parameters
    ----------
    text : str
        TOML; lines to fill in are comments.
    missing : tuple of str
        What the files do not tell, in words.
    """

    text: str
    missing: tuple[str, ...]


def draft_manifest(folder: Path) -> Draft:
    """Draft a manifest from the recordings in a folder.

    Parameters
    ----------
    folder : Path

    Raises
    ------
    InputError
        If the folder holds no recordings, or one cannot be read.
    """
    files = sorted(path for path in folder.iterdir() if path.is_file() and is_recording(path))
    recordings = [found for path in files if (found := read_file(path).recording) is not None]
    if not recordings:
        raise InputError(
            str(folder),
            "no recordings with time series",
            "a manifest is drafted from recordings",
            "Copy the files there, or name another folder",
        )
    force, reference = _force(recordings), _reference(recordings)
    positions = _positions(recordings, reference)
    missing = ["[tyre] inflation_pressure_pa and mean_radius_m, for the ring parameters"]
    if force is None:
        missing.append("[excitation] channel, the force")
    if positions is None:
        missing.append("positions_deg of each run, the angles of the sensors")
    parts = [
        _TO_FILL_IN,
        "schema = 1\n",
        _tyre(folder),
        _acquisition(recordings),
        f"[grid]\npositions = {positions or 72}\n",
        _excitation(force),
        *(_run(recording, reference, force, positions) for recording in recordings),
    ]
    return Draft("\n".join(part for part in parts if part), tuple(missing))


def write_draft(folder: Path, draft: Draft, *, force: bool = False) -> Path:
    """Write a draft beside the recordings; an existing manifest is replaced only with `force`."""
    path = folder / MANIFEST_NAME
    if path.exists() and not force:
        raise InputError(
            str(path), "a manifest", "it is not overwritten unasked", "Move it away, or use --force"
        )
    path.write_text(draft.text, encoding="utf-8", newline="\n")
    return path


def _force(recordings: list[Recording]) -> str | None:
    names = {c.name for r in recordings for c in r.channels if c.quantity == FORCE}
    return names.pop() if len(names) == 1 else None


def _reference(recordings: list[Recording]) -> str | None:
    """Name of the channel that looks like the fixed sensor: by its word, or by a steady node."""
    names = Counter(c.name for r in recordings for c in _sensors(r))
    common = [name for name, count in names.items() if count == len(recordings)]
    called = [name for name in common if name.lower().startswith(_REFERENCE_WORD)]
    if called or len(recordings) < 2:
        return called[0] if called else None
    nodes = {
        name: {c.node for r in recordings for c in _sensors(r) if c.name == name} for name in common
    }
    fixed = [name for name, where in nodes.items() if len(where) == 1 and None not in where]
    return fixed[0] if len(fixed) == 1 else None


def _positions(recordings: list[Recording], reference: str | None) -> int | None:
    """Grid that the node numbers fill; None where they do not fill one."""
    nodes = [c.node for r in recordings for c in _sensors(r) if c.name != reference]
    if not nodes or None in nodes or len(set(nodes)) < len(nodes):
        return None
    highest = max(node for node in nodes if node is not None)
    fitting = [grid for grid in _PROBABLE_GRIDS if highest <= grid and len(nodes) <= grid]
    return len(nodes) if len(nodes) in fitting else next(iter(sorted(fitting)), None)


def _sensors(recording: Recording) -> list[Channel]:
    return [c for c in recording.channels if c.quantity == ACCELERATION]


def _tyre(folder: Path) -> str:
    name = _text(folder.resolve().name)
    return (
        f"[tyre]\ndesignation = {name}\n"
        "# inflation_pressure_pa = <Pa>   # required for the ring parameters\n"
        "# mean_radius_m = <m>            # required for the ring parameters\n"
        "# belt_width_m = <m>             # optional: absolute amplitudes of the ring model\n"
    )


def _acquisition(recordings: list[Recording]) -> str:
    rate = recordings[0].sampling_rate_hz
    if rate != rate:
        return "[acquisition]\n# sampling_rate_hz = <Hz>          # the files do not say\n"
    return f"[acquisition]\nsampling_rate_hz = {float(rate)!r}\n"


def _excitation(force: str | None) -> str:
    channel = f"channel = {_text(force)}" if force else "# channel = <name of the force>"
    return f'[excitation]\n{channel}\nposition_deg = 0.0\ndirection = "radial"\n'


def _run(
    recording: Recording, reference: str | None, force: str | None, positions: int | None
) -> str:
    lines = ["[[runs]]", f"file = {_text(recording.path.name)}"]
    if reference is not None and reference in recording.names:
        lines.append(f"reference = {_text(reference)}")
    sensors = [c for c in _sensors(recording) if c.name != reference]
    if positions is None:
        names = ", ".join(f"{_text(c.name)} = <deg>" for c in sensors)
        lines.append(f"# positions_deg = {{ {names} }}")
    else:
        lines.append("# positions follow from the node numbers in the file")
    return "\n".join(lines) + "\n"


def _text(value: Any) -> str:
    import tomlkit

    return tomlkit.item(str(value)).as_string()
