"""The command line's ``ringmodal simulate``."""

from __future__ import annotations

import math
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from model import Cleat, CleatTest, ForcedRing, hub_response
from pipelines.cli import simulate_options, simulate_show, terminal
from pipelines.cli.help import Command, Group
from pipelines.cli.interrupt import stating_what_stands
from pipelines.cli.options import AcceptChanges
from pipelines.cli.simulate_options import (
    Directions,
    Frames,
    Hubs,
    PressureLoads,
    Quantities,
    WaveFrames,
)
from pipelines.cli.simulate_ranges import orders_of, values_of
from pipelines.simulate.campaign import simulate_campaign
from pipelines.simulate.responses import (
    MOST_LOADS,
    Observer,
    simulate_cleat,
    simulate_inertance,
    simulate_loaded,
)
from pipelines.simulate.tyre import damping_of, simulate_frequencies, wheel_of

simulate = typer.Typer(
    cls=Group,
    help="The ring model at work: frequencies, forced vibration, virtual measurements.",
    no_args_is_help=True,
    rich_markup_mode=None,
)


class FileFormat(StrEnum):
    """Format of simulated recordings."""

    uff = "uff"
    csv = "csv"


@simulate.command(cls=Command)
def campaign(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="New or empty folder.")],
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
    as_json: simulate_options.Json = False,
) -> None:
    """Write a whole virtual campaign on a tyre with known modes; the truth lies beside it.

    Example:
      ringmodal simulate campaign virtual --duration-s 60 --snr-db 20
    """
    with stating_what_stands(folder):
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
    if as_json:
        terminal.print_json({"campaign": str(written)})
        return
    terminal.say(f"Campaign: {written}")
    terminal.say(f"Next: ringmodal process {written} --out result")


@simulate.command(cls=Command)
def frequencies(
    tyre: simulate_options.Tyre = None,
    accept_changes: AcceptChanges = False,
    orders: Annotated[str, typer.Option(metavar="FROM:TO", help="Orders n ≥ 1.")] = "1:7",
    speed_rad_s: Annotated[
        str, typer.Option(metavar="FROM:TO:STEP", help="Angular speed in rad/s, one or several.")
    ] = "0",
    frame: Annotated[WaveFrames, typer.Option(help="Where the observer is.")] = WaveFrames.rotating,
    extensional: Annotated[bool, typer.Option(help="The extensional waves instead.")] = False,
    pressure_load: simulate_options.PressureLoad = PressureLoads.dead,
    out: simulate_options.Out = None,
    figure: simulate_options.FigureFile = None,
    as_json: simulate_options.Json = False,
) -> None:
    """Frequencies in Hz of the regressive and the progressive wave of each order, over speed.

    Example:
      ringmodal simulate frequencies --speed-rad-s 0:100:1 --orders 1:4 --out waves.csv
    """
    found = simulate_frequencies(
        simulate_show.announced(tyre, accept_changes=accept_changes).ring,
        orders_of("--orders", orders),
        values_of("--speed-rad-s", speed_rad_s),
        frame.value,
        extensional=extensional,
        pressure_load=pressure_load.value,
    )
    simulate_show.frequencies(found, frame.value, simulate_show.Targets(out, figure, as_json))


@simulate.command(cls=Command)
def inertance(
    tyre: simulate_options.Tyre = None,
    accept_changes: AcceptChanges = False,
    at_deg: simulate_options.AtAngle = 100.0,
    force_deg: simulate_options.ForceAngle = 0.0,
    speed_rad_s: simulate_options.Speed = 0.0,
    frequency_hz: simulate_options.FrequencyRange = "20:300:0.1",
    harmonics: simulate_options.Harmonics = 200,
    frame: Annotated[
        Frames, typer.Option(help="Whether force and response stay on the tyre or in space.")
    ] = Frames.rotating,
    inextensional: Annotated[bool, typer.Option(help="Take the belt as inextensible.")] = False,
    pretension_loss: simulate_options.PretensionLoss = True,
    pressure_load: simulate_options.PressureLoad = PressureLoads.dead,
    out: simulate_options.Out = None,
    figure: simulate_options.FigureFile = None,
    as_json: simulate_options.Json = False,
) -> None:
    """Radial inertance between two angles in (m/s²)/N; in (m/s²)/(N/m) without a belt width.

    Example:
      ringmodal simulate inertance --at-deg 100 --speed-rad-s 67.3 --out inertance.csv
    """
    chosen = simulate_show.announced(tyre, accept_changes=accept_changes)
    forced = ForcedRing(
        chosen.ring,
        damping_of(chosen, on_pretension=pretension_loss),
        speed_rad_s,
        pressure_load=pressure_load.value,
        highest_order=harmonics,
        frame=frame.value,
    )
    lines = values_of("--frequency-hz", frequency_hz)
    found = simulate_inertance(forced, lines, at_deg, force_deg, inextensional=inextensional)
    simulate_show.inertance(found, chosen, simulate_show.Targets(out, figure, as_json))


@simulate.command(cls=Command)
def cleat(
    tyre: simulate_options.Tyre = None,
    accept_changes: AcceptChanges = False,
    at_deg: simulate_options.AtAngle = 100.0,
    frame: Annotated[
        Frames, typer.Option(help="Whether the point watched stays on the tyre or in space.")
    ] = Frames.rotating,
    direction: Annotated[Directions, typer.Option(help="Component.")] = Directions.radial,
    quantity: Annotated[Quantities, typer.Option(help="m, m/s or m/s².")] = Quantities.acceleration,
    speed_rad_s: simulate_options.Speed = 67.3,
    contact_deg: Annotated[float, typer.Option(help="Angle of the contact in degrees.")] = 0.0,
    radial_n_s: Annotated[
        float, typer.Option(help="Radial momentum of the blow in N s, outwards positive.")
    ] = -1.0,
    circumferential_n_s: Annotated[
        float, typer.Option(help="Circumferential momentum of the blow in N s.")
    ] = 0.0,
    duration_s: Annotated[
        float, typer.Option(help="Length of the half-sine in s; 0 for an ideal impulse.")
    ] = 0.004,
    force_frame: Annotated[
        Frames, typer.Option(help="Whether the blow stays on the tread it hits or in space.")
    ] = Frames.rotating,
    times_s: Annotated[str, typer.Option(metavar="FROM:TO:STEP", help="Times in s.")] = (
        "0:0.3:0.0005"
    ),
    frequency_hz: simulate_options.FrequencyRange = "0:300:0.5",
    harmonics: simulate_options.Harmonics = 200,
    pretension_loss: simulate_options.PretensionLoss = True,
    out: simulate_options.Out = None,
    spectrum: simulate_options.SpectrumFile = None,
    figure: simulate_options.FigureFile = None,
    as_json: simulate_options.Json = False,
) -> None:
    """What a point of the rolling tyre feels when it runs over a cleat, in time and frequency.

    Example:
      ringmodal simulate cleat --at-deg 90 --frame absolute --figure cleat.png
    """
    chosen = simulate_show.announced(tyre, accept_changes=accept_changes)
    forced = ForcedRing(
        chosen.ring,
        damping_of(chosen, on_pretension=pretension_loss),
        speed_rad_s,
        highest_order=harmonics,
        frame=force_frame.value,
    )
    blow = Cleat(radial_n_s, circumferential_n_s, duration_s, math.radians(contact_deg))
    observer = Observer(
        at_deg,
        frame.value,
        direction.value,
        quantity.value,
    )
    found = simulate_cleat(
        CleatTest(forced, blow),
        observer,
        values_of("--times-s", times_s),
        values_of("--frequency-hz", frequency_hz),
    )
    simulate_show.cleat(found, simulate_show.Targets(out, figure, as_json), spectrum)


@simulate.command(cls=Command)
def loaded(
    tyre: simulate_options.Tyre = None,
    accept_changes: AcceptChanges = False,
    load_n: Annotated[
        str, typer.Option(metavar="FROM:TO:STEP", help="Vertical loads in N; 0 is the free tyre.")
    ] = "0:4000:1000",
    modes: Annotated[int, typer.Option(min=1, help="How many of the lowest modes.")] = 15,
    harmonics: Annotated[
        int, typer.Option(min=8, max=200, help="Harmonics of the deflected shape.")
    ] = 60,
    pressure_load: simulate_options.PressureLoad = PressureLoads.dead,
    out: simulate_options.Out = None,
    figure: simulate_options.FigureFile = None,
    as_json: simulate_options.Json = False,
) -> None:
    """Natural frequencies in Hz of the standing tyre pressed on the road, over vertical load.

    Example:
      ringmodal simulate loaded --load-n 0:4000:500 --figure loaded.svg
    """
    found = simulate_loaded(
        simulate_show.announced(tyre, accept_changes=accept_changes).ring,
        values_of("--load-n", load_n, MOST_LOADS),
        modes,
        highest_order=harmonics,
        pressure_load=pressure_load.value,
    )
    simulate_show.loaded(found, simulate_show.Targets(out, figure, as_json))


@simulate.command(cls=Command)
def hub(
    tyre: simulate_options.Tyre = None,
    accept_changes: AcceptChanges = False,
    hub: Annotated[Hubs, typer.Option(help="Whether the wheel can move.")] = Hubs.fixed,
    wheel_mass_kg: Annotated[
        float | None, typer.Option(help="Mass of the wheel in kg, in place of the tyre's own.")
    ] = None,
    wheel_inertia_kg_m2: Annotated[
        float | None,
        typer.Option(help="Its moment of inertia in kg m², in place of the tyre's own."),
    ] = None,
    force_deg: simulate_options.ForceAngle = 0.0,
    direction: Annotated[
        Directions, typer.Option(help="Direction of the force.")
    ] = Directions.radial,
    speed_rad_s: simulate_options.Speed = 0.0,
    frequency_hz: simulate_options.FrequencyRange = "1:300:0.25",
    frame: Annotated[
        Frames, typer.Option(help="Whether force and axes stay on the tyre or in space.")
    ] = Frames.absolute,
    pretension_loss: simulate_options.PretensionLoss = True,
    out: simulate_options.Out = None,
    figure: simulate_options.FigureFile = None,
    as_json: simulate_options.Json = False,
) -> None:
    """Forces in N/N and moment in N m/N at the hub per unit of force on the belt.

    A free wheel also moves (m/N, rad/N); pressure then follows the belt.

    Example:
      ringmodal simulate hub --hub free --wheel-mass-kg 12 --wheel-inertia-kg-m2 0.6
    """
    chosen = simulate_show.announced(tyre, accept_changes=accept_changes)
    wheel = None
    if hub is Hubs.free:
        wheel = wheel_of(chosen.wheel, wheel_mass_kg, wheel_inertia_kg_m2)
    forced = ForcedRing(
        chosen.ring,
        damping_of(chosen, on_pretension=pretension_loss),
        speed_rad_s,
        wheel,
        frame=frame.value,
    )
    found = hub_response(
        forced,
        values_of("--frequency-hz", frequency_hz),
        math.radians(force_deg),
        force_direction=direction.value,
    )
    simulate_show.hub(found, forced, simulate_show.Targets(out, figure, as_json))
