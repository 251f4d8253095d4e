"""The command line's ``ringmodal simulate``."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

simulate = typer.Typer(help="The ring model at work: virtual measurements.", no_args_is_help=True)


class FileFormat(StrEnum):
    """Format of simulated recordings."""

    uff = "uff"
    csv = "csv"


@simulate.callback()
def _group() -> None:
    """Keep the commands below the group, however few they are."""


@simulate.command()
def campaign(
    folder: Annotated[Path, typer.Argument(help="New or empty folder.")],
    seed: Annotated[int, typer.Option(min=0, help="Same seed, same bytes.")] = 1,
    duration_s: Annotated[float, typer.Option(help="Length of each of the six runs in s.")] = 20.0,
    sampling_rate_hz: Annotated[float, typer.Option(help="Sampling rate in Hz.")] = 2000.0,
    snr_db: Annotated[float, typer.Option(help="Mean response over sensor noise in dB.")] = 34.0,
    file_format: Annotated[
        FileFormat, typer.Option("--format", help="Universal files (58b) or tables of text.")
    ] = FileFormat.uff,
    split_percent: Annotated[
        float, typer.Option(help="Split of each order into a pair, percent of its frequency.")
    ] = 0.0,
    shaker_between: Annotated[
        float, typer.Option(help="Shaker in a pair: 0 drives member a alone, 1 member b.")
    ] = 0.5,
    sensor_mass_kg: Annotated[float, typer.Option(help="Mass of each sensor in kg.")] = 0.0,
    drift_percent: Annotated[
        float, typer.Option(help="Rise of all frequencies from run to run in percent.")
    ] = 0.0,
) -> None:
    """Write a whole virtual campaign on a tyre with known modes; the truth lies beside it.

    Example: ringmodal simulate campaign virtual --duration-s 60 --snr-db 20
    """
    from pipelines.simulate_campaign import simulate_campaign

    written = simulate_campaign(
        folder,
        seed=seed,
        duration_s=duration_s,
        sampling_rate_hz=sampling_rate_hz,
        snr_db=snr_db,
        file_format=file_format.value,
        split_percent=split_percent,
        shaker_between=shaker_between,
        sensor_mass_kg=sensor_mass_kg,
        drift_percent=drift_percent,
    )
    typer.echo(f"Campaign: {written}")
    typer.echo(f"Next: ringmodal process {written} --out result")
