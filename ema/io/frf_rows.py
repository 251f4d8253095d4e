"""FRFs of several files as one set, with their places."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ema._arrays import stacked
from ema.errors import RecordingFormatError
from ema.frf import FRF
from ema.io.content import FileContent
from ema.io.positions import Grid
from ema.quality import Finding
from ema.recording import ACCELERATION, Channel


def merge(
    contents: Sequence[FileContent],
    positions_deg: Sequence[dict[str, float] | None],
    positions: int | None,
) -> tuple[FRF, list[Finding]]:
    """Stack the FRFs of all files that hold some; they share their frequency lines.

    Parameters
    ----------
    contents : sequence of FileContent
        Files with an `frf`.
    positions_deg : sequence of dict or None
        Angles by name, for each file.
    positions : int or None
        Number of grid positions.

    Raises
    ------
    RecordingFormatError
        If lines differ between files.
    ManifestError
        If there is a grid and the place of a row is not known.
    """
    frfs = [content.frf for content in contents if content.frf is not None]
    first = frfs[0].frequency_hz
    for content, frf in zip(contents, frfs, strict=True):
        lines = frf.frequency_hz
        if len(lines) != len(first) or not np.allclose(lines, first, rtol=1e-6):
            found = f"{len(lines)} lines to {lines[-1]:g} Hz"
            rule = f"{contents[0].path.name} has {len(first)} to {first[-1]:g} Hz"
            remedy = "Process files of different resolution one by one"
            raise RecordingFormatError(content.path.name, found, rule, remedy)
    rows = [_rows_as_channels(content) for content in contents]
    channels = [channel for of_file in rows for channel in of_file]
    grid = Grid.over(positions, channels)
    findings: list[Finding] = []
    places = [
        grid.place(content.path, channel, given, findings)
        for content, of_file, given in zip(contents, rows, positions_deg, strict=True)
        for channel in of_file
    ]
    return FRF(
        frequency_hz=first,
        values=stacked([frf.values for frf in frfs]),
        coherence=stacked([frf.coherence for frf in frfs]),
        std=stacked([frf.std for frf in frfs]),
        node=np.array([-1 if place.node is None else place.node for place in places]),
        position_deg=np.array(
            [np.nan if place.angle_deg is None else place.angle_deg for place in places]
        ),
        run=tuple(run for frf in frfs for run in frf.run),
    ), findings


def _rows_as_channels(content: FileContent) -> list[Channel]:
    """Name, node and angle of each row, as a channel without samples."""
    frf = content.frf
    assert frf is not None
    names = [
        name if content.frf_names.count(name) == 1 else f"{name} #{row}"
        for row, name in enumerate(content.frf_names, 1)
    ]
    return [
        Channel(
            name=name,
            quantity=ACCELERATION,
            unit="",
            samples=frf.frequency_hz[:0],
            node=int(node),
            angle_deg=None if np.isnan(angle) else float(angle),
        )
        for name, node, angle in zip(names, frf.node, frf.position_deg, strict=True)
    ]
