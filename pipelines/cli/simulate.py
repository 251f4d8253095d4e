"""``ringmodal simulate`` and ``paper``: the ring model, virtual measurements, the paper."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal

from ema.core.errors import InputError
from model import Cleat, CleatTest, ForcedRing, Tread, hub_response
from model.cleat import Quantity
from model.coefficients import PressureLoad
from model.forced import Direction
from model.ring import Frame, WaveFrame
from pipelines.cli import options as opt
from pipelines.cli import show_tyre
from pipelines.cli.app import Command, group
from pipelines.cli.options import Force, Json, Out, Quiet
from pipelines.cli.screen import shown
from pipelines.cli.show_tyre import Request
from pipelines.cli.streams import reporting_outcome
from pipelines.cli.terminal import echo, echo_error, print_json
from pipelines.paper.reproduce import PAGE, reproduce_paper
from pipelines.simulate import responses
from pipelines.simulate.campaign import simulate_campaign
from pipelines.simulate.laboratory import simulate_laboratory
from pipelines.simulate.laboratory_effects import effects_of
from pipelines.simulate.responses import (
    damping_of,
    simulate_frequencies,
    tyre_to_simulate,
    wheel_of,
)

simulate = group("Ring model: frequencies, forced vibration, virtual measurements.")


def _values(text: str) -> Any:
    """An option that takes one value, several, or a range."""
    return opt.option(text, metavar="FROM:TO:STEP")


Speed = Annotated[float, opt.option("Angular speed of the tyre in rad/s.")]
Frequencies = Annotated[str, _values("Frequencies in Hz.")]
AtAngle = Annotated[float, opt.option("Angle of the response in degrees.")]
ForceAngle = Annotated[float, opt.option("Angle of the force in degrees.")]
Harmonics = Annotated[
    int, opt.option("Sum harmonics −N … N of the circumference.", min=1, max=2000)
]
Pressure = Annotated[
    PressureLoad | None,
    opt.option(
        "Pressure as the paper's dead load, or normal to the belt (follower): the ring is "
        "converted. Default: that of the parameter set."
    ),
]
Hub = Annotated[Literal["fixed", "free"], opt.option("Whether the wheel can move.")]
WheelMass = Annotated[
    float | None, opt.option("Mass of the wheel in kg, instead of that of --tyre.")
]
WheelInertia = Annotated[
    float | None, opt.option("Its moment of inertia in kg m², instead of that of --tyre.")
]
PretensionLoss = Annotated[
    bool, opt.option("Whether the loss factor also acts on the stiffness from hoop tension.")
]


def _requested(
    *,
    tyre: Annotated[
        Path | None, opt.option("Tyre.toml or result folder. Default: the sample tyre.", opt.FILES)
    ] = None,
    accept_changes: opt.AcceptChanges = False,
    out: Annotated[Path | None, opt.target("Table", opt.TABLE_ENDINGS)] = None,
    figure: Annotated[Path | None, opt.target("Picture", opt.FIGURE_ENDINGS)] = None,
    as_json: opt.Json = False,
) -> Request:
    """The tyre to simulate and where the result goes, from the command line."""
    chosen = tyre_to_simulate(tyre, accept_changes=accept_changes)
    if tyre is None:
        echo_error(f"No --tyre given: the parameters are those of {chosen.name}.")
    return Request(chosen, out, figure, as_json)


def _command(function: Callable[..., None]) -> Callable[..., None]:
    return simulate.command(cls=Command)(opt.sharing("request", _requested, function))


@simulate.command(cls=Command)
def campaign(
    folder: Annotated[Path, opt.argument("DIR", "New or empty folder.")],
    seed: Annotated[int, opt.option("Same seed, same bytes.", min=0)] = 1,
    duration_s: Annotated[float, opt.option("Length of each of the six runs in s.")] = 20.0,
    sampling_rate_hz: Annotated[float, opt.option("Sampling rate in Hz.")] = 2000.0,
    snr_db: Annotated[float, opt.option("Mean response over sensor noise in dB.")] = 34.0,
    file_format: Annotated[
        Literal["uff", "csv"],
        opt.option("Universal files (58b) or tables of text.", "", "", "--format"),
    ] = "uff",
    split_percent: Annotated[
        float, opt.option("Split of each order into a pair, percent of its frequency.")
    ] = 0.0,
    shaker_between: Annotated[
        float, opt.option("Shaker in a pair: 0 drives member a alone, 1 member b.")
    ] = 0.5,
    sensor_mass_kg: Annotated[float, opt.option("Mass of each sensor in kg.")] = 0.0,
    drift_percent: Annotated[
        float, opt.option("Rise of all frequencies from run to run in percent.")
    ] = 0.0,
    force_deg: Annotated[
        list[float] | None,
        opt.option("Angle of the force in degrees, 0 by default; repeat it for several."),
    ] = None,
    at_once: Annotated[
        bool, opt.option("Whether several forces act at the same time, not one after the other.")
    ] = False,
    effect: Annotated[
        list[str] | None,
        opt.option("Effect of a real laboratory, e.g. splice=0.004; repeatable.", "", "NAME=VALUE"),
    ] = None,
    effects: Annotated[
        Path | None, opt.option("TOML file with such effects.", metavar="FILE")
    ] = None,
    as_json: opt.Json = False,
) -> None:
    """Write a virtual campaign on a tyre with known modes, which are in truth.toml.

    With effects, tyre and test are those of a real laboratory and the modes are in truth.json. The
    documentation lists the effects ("A virtual laboratory").

    Examples:
      ringmodal simulate campaign virtual --duration-s 60 --snr-db 20
      ringmodal simulate campaign pairs --split-percent 1 --force-deg 0 --force-deg 22.5
      ringmodal simulate campaign hammer --effect excitation=hammer --effect splice=0.004
    """  # noqa: D406, D407 - a heading of the help
    common: dict[str, Any] = {"seed": seed, "snr_db": snr_db, "sensor_mass_kg": sensor_mass_kg}
    common |= {"duration_s": duration_s, "sampling_rate_hz": sampling_rate_hz}
    places = force_deg or [0.0]
    moved = {"force_deg": places[0], "further_forces_deg": places[1:]} if force_deg else {}
    laboratory = effects_of(effects, effect or (), common | moved)
    with reporting_outcome(folder):
        if laboratory is None:
            common |= {"file_format": file_format, "split_percent": split_percent}
            common |= {"shaker_between": shaker_between, "drift_percent": drift_percent}
            common |= {"force_deg": places, "at_once": at_once}
            written = simulate_campaign(folder, **common)
        else:
            if (file_format, split_percent, drift_percent, at_once) != ("uff", 0.0, 0.0, False):
                found = "given with --format csv, --split-percent, --drift-percent or --at-once"
                rule = "effects have files, pairs and drift of their own, and one shaker"
                remedy = "Use the effects stiffness_variation, temperature_drift or pressure_drift"
                raise InputError("--effect", found, rule, remedy)
            written = simulate_laboratory(folder, laboratory)
    if as_json:
        print_json({"campaign": str(written)})
        return
    echo(f"Campaign: {written}")
    echo(f"Next: ringmodal process {written} --out result")


@_command
def frequencies(
    request: Request,
    orders: Annotated[str, opt.option("Orders n ≥ 1.", metavar="FROM:TO")] = "1:7",
    speed_rad_s: Annotated[str, _values("Angular speed in rad/s, one or several.")] = "0",
    frame: Annotated[WaveFrame, opt.option("Where the observer is.")] = "rotating",
    extensional: Annotated[bool, opt.option("Extensional instead of bending waves.")] = False,
    pressure_load: Pressure = None,
) -> None:
    """Frequencies in Hz of the regressive and the progressive wave of each order, over speed.

    Example:
      ringmodal simulate frequencies --speed-rad-s 0:100:1 --orders 1:4 --out waves.csv
    """
    ring, load = request.tyre.under(pressure_load)
    found = simulate_frequencies(
        ring,
        opt.orders_of("--orders", orders),
        opt.values_of("--speed-rad-s", speed_rad_s),
        frame,
        extensional=extensional,
        pressure_load=load,
    )
    show_tyre.frequencies(found, frame, request)


@_command
def inertance(
    request: Request,
    at_deg: AtAngle = 100.0,
    force_deg: ForceAngle = 0.0,
    speed_rad_s: Speed = 0.0,
    frequency_hz: Frequencies = "20:300:0.1",
    harmonics: Harmonics = 200,
    frame: Annotated[
        Frame, opt.option("Whether force and response stay on the tyre or in space.")
    ] = "rotating",
    inextensional: Annotated[bool, opt.option("Take the belt as inextensible.")] = False,
    pretension_loss: PretensionLoss = True,
    pressure_load: Pressure = None,
) -> None:
    """Radial inertance between two angles in (m/s²)/N; in (m/s²)/(N/m) without a belt width.

    Example:
      ringmodal simulate inertance --at-deg 100 --speed-rad-s 67.3 --out inertance.csv
    """
    damping = damping_of(request.tyre, on_pretension=pretension_loss)
    ring, load = request.tyre.under(pressure_load)
    options: dict[str, Any] = {"pressure_load": load, "frame": frame}
    forced = ForcedRing(ring, damping, speed_rad_s, highest_order=harmonics, **options)
    lines = opt.values_of("--frequency-hz", frequency_hz)
    found = responses.simulate_inertance(
        forced, lines, at_deg, force_deg, inextensional=inextensional
    )
    show_tyre.inertance(found, request)


@_command
def cleat(
    request: Request,
    at_deg: AtAngle = 100.0,
    frame: Annotated[
        Frame, opt.option("Whether the observed point stays on the tyre or in space.")
    ] = "rotating",
    direction: Annotated[Direction, opt.option("Component.")] = "radial",
    quantity: Annotated[Quantity, opt.option("m, m/s or m/s².")] = "acceleration",
    speed_rad_s: Speed = 67.3,
    contact_deg: Annotated[float, opt.option("Angle of the contact in degrees.")] = 0.0,
    radial_n_s: Annotated[
        float, opt.option("Radial momentum of the impact in N s, outwards positive.")
    ] = -1.0,
    circumferential_n_s: Annotated[
        float, opt.option("Circumferential momentum of the impact in N s.")
    ] = 0.0,
    duration_s: Annotated[
        float, opt.option("Length of the half-sine in s; 0 for an ideal impulse.")
    ] = 0.004,
    force_frame: Annotated[
        Frame, opt.option("Whether the impact stays on the tread or in space.")
    ] = "rotating",
    times_s: Annotated[str, _values("Times in s.")] = "0:0.3:0.0005",
    frequency_hz: Frequencies = "0:300:0.5",
    harmonics: Harmonics = 200,
    pretension_loss: PretensionLoss = True,
    spectrum: Annotated[Path | None, opt.target("Spectrum", opt.TABLE_ENDINGS)] = None,
) -> None:
    """Response of a point of the rolling tyre to a cleat, in time and frequency.

    Example:
      ringmodal simulate cleat --at-deg 90 --frame absolute --figure cleat.png
    """
    damping = damping_of(request.tyre, on_pretension=pretension_loss)
    ring, load = request.tyre.under(None)
    options: dict[str, Any] = {"pressure_load": load, "frame": force_frame}
    options["highest_order"] = harmonics
    forced = ForcedRing(ring, damping, speed_rad_s, **options)
    impact = Cleat(radial_n_s, circumferential_n_s, duration_s, math.radians(contact_deg))
    observer = responses.Observer(at_deg, frame, direction, quantity)
    test, times = CleatTest(forced, impact), opt.values_of("--times-s", times_s)
    lines = opt.values_of("--frequency-hz", frequency_hz)
    found = responses.simulate_cleat(test, observer, times, lines)
    show_tyre.cleat(found, request, spectrum)


@_command
def loaded(
    request: Request,
    load_n: Annotated[str, _values("Vertical loads in N; 0 is the free tyre.")] = "0:4000:1000",
    tread_radial_n_m3: Annotated[
        float, opt.option("Stiffness of the tread per area, normal to the road; 0: see above.")
    ] = Tread.radial_n_m3,
    tread_tangential_n_m3: Annotated[
        float, opt.option("The same along the road; 0 lets the patch slide.")
    ] = Tread.tangential_n_m3,
    modes: Annotated[int, opt.option("How many of the lowest modes.", min=1)] = 15,
    harmonics: Annotated[int, opt.option("Harmonics of the deflected shape.", min=8, max=200)] = 60,
    pressure_load: Pressure = None,
    hub: Hub = "fixed",
    wheel_mass_kg: WheelMass = None,
    wheel_inertia_kg_m2: WheelInertia = None,
) -> None:
    """Natural frequencies in Hz of the standing tyre on a flat road, over vertical load.

    The tread holds the patch, and its compression adds to the deflection of the belt. With a free
    hub the pressure follows the belt. Without a stiffness normal to the road a parabolic contact
    pressure is given and the patch vibrates freely.

    Example:
      ringmodal simulate loaded --load-n 0:4000:500 --figure loaded.svg
    """
    given = (wheel_mass_kg, wheel_inertia_kg_m2)
    wheel = wheel_of(request.tyre.wheel, *given) if hub == "free" else None
    tread = Tread(tread_radial_n_m3, tread_tangential_n_m3)
    if tread.radial_n_m3 == 0 and wheel is not None:
        rule, remedy = "a free hub stands on its tread", "Give a stiffness greater than zero"
        raise InputError("--tread-radial-n-m3", "0", rule, remedy)
    ring, load = request.tyre.under("follower" if wheel else pressure_load)
    found = responses.simulate_loaded(
        ring,
        opt.values_of("--load-n", load_n, responses.MOST_LOADS),
        modes,
        tread if tread.radial_n_m3 else None,
        wheel=wheel,
        highest_order=harmonics,
        pressure_load=load,
    )
    show_tyre.loaded(found, request)


@_command
def hub(
    request: Request,
    hub: Hub = "fixed",
    wheel_mass_kg: WheelMass = None,
    wheel_inertia_kg_m2: WheelInertia = None,
    force_deg: ForceAngle = 0.0,
    direction: Annotated[Direction, opt.option("Direction of the force.")] = "radial",
    speed_rad_s: Speed = 0.0,
    frequency_hz: Frequencies = "1:300:0.25",
    frame: Annotated[
        Frame, opt.option("Whether force and axes stay on the tyre or in space.")
    ] = "absolute",
    pretension_loss: PretensionLoss = True,
) -> None:
    """Forces in N/N and moment in N m/N at the hub per unit of force on the belt.

    A free wheel also moves (m/N, rad/N); pressure then follows the belt.

    Example:
      ringmodal simulate hub --hub free --wheel-mass-kg 12 --wheel-inertia-kg-m2 0.6
    """
    given = (wheel_mass_kg, wheel_inertia_kg_m2)
    wheel = wheel_of(request.tyre.wheel, *given) if hub == "free" else None
    damping = damping_of(request.tyre, on_pretension=pretension_loss)
    ring, load = request.tyre.under("follower" if wheel else None)
    forced = ForcedRing(ring, damping, speed_rad_s, wheel, load, frame=frame)
    lines, angle = opt.values_of("--frequency-hz", frequency_hz), math.radians(force_deg)
    found = hub_response(forced, lines, angle, force_direction=direction)
    show_tyre.hub(found, forced, request)


def paper(out: Out, force: Force = False, as_json: Json = False, quiet: Quiet = False) -> None:
    """Compute the tables and figures of the paper on the ring model, next to the printed values.

    Example:
      ringmodal paper --out paper
    """
    with reporting_outcome(out), shown(quiet=quiet) as progress:
        chapters = reproduce_paper(out, force=force, progress=progress.stage)
    statements = [one for chapter in chapters for one in chapter.statements]
    if as_json:
        rows = [
            {"place": one.place, "verdict": one.verdict, "found": one.found} for one in statements
        ]
        print_json({"report": str(out / PAGE), "statements": rows})
        return
    for one in statements:
        echo(f"{one.place}: {one.verdict}. {one.found}")
    echo(f"Report: {out / PAGE}")
