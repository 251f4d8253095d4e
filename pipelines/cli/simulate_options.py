"""Options that the simulations on the command line share."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from pipelines.cli.values import FIGURE_ENDINGS, TABLE_ENDINGS, require_target


class Frames(StrEnum):
    """Where an observer or a force is: on the tyre, or in space."""

    rotating = "rotating"
    absolute = "absolute"


class WaveFrames(StrEnum):
    """Where an observer of waves is."""

    rotating = "rotating"
    absolute = "absolute"
    stationary = "stationary"


class Directions(StrEnum):
    """Direction on the belt."""

    radial = "radial"
    circumferential = "circumferential"


class Quantities(StrEnum):
    """What a point reads."""

    displacement = "displacement"
    velocity = "velocity"
    acceleration = "acceleration"


class PressureLoads(StrEnum):
    """How the inflation pressure follows the belt."""

    dead = "dead"
    follower = "follower"


class Hubs(StrEnum):
    """Whether the wheel can move."""

    fixed = "fixed"
    free = "free"


def _table(path: Path | None) -> Path | None:
    return None if path is None else require_target(path, TABLE_ENDINGS)


def _figure(path: Path | None) -> Path | None:
    return None if path is None else require_target(path, FIGURE_ENDINGS)


Tyre = Annotated[
    Path | None,
    typer.Option(
        help="Parameter set: a tyre.toml or a result folder. Without one the sample tyre, a "
        "225/55R17."
    ),
]
Out = Annotated[
    Path | None, typer.Option("--out", callback=_table, help="Table: .csv or .parquet.")
]
FigureFile = Annotated[
    Path | None, typer.Option("--figure", callback=_figure, help="Picture: .png or .svg.")
]
SpectrumFile = Annotated[
    Path | None, typer.Option("--spectrum", callback=_table, help="Spectrum: .csv or .parquet.")
]
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON on standard output.")]
Speed = Annotated[float, typer.Option(help="Angular speed of the tyre in rad/s.")]
FrequencyRange = Annotated[
    str, typer.Option("--frequency-hz", metavar="FROM:TO:STEP", help="Frequencies in Hz.")
]
AtAngle = Annotated[float, typer.Option(help="Angle of the response in degrees.")]
ForceAngle = Annotated[float, typer.Option(help="Angle of the force in degrees.")]
Harmonics = Annotated[
    int, typer.Option(min=1, max=2000, help="Harmonics −N … N of the circumference to sum.")
]
PressureLoad = Annotated[
    PressureLoads,
    typer.Option(help="Pressure as the paper's dead load, or normal to the belt."),
]
PretensionLoss = Annotated[
    bool,
    typer.Option(
        "--pretension-loss/--no-pretension-loss",
        help="Whether the loss factor also acts on the stiffness from hoop tension.",
    ),
]
