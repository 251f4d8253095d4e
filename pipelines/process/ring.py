"""Tuning of the ring to identified modes, at once or again; modes of other directions beside it."""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Iterator, Sequence
from dataclasses import replace
from inspect import signature
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

import ema
import model
from ema.core.campaign import Campaign, Direction, Run, Tyre
from ema.core.errors import FitError, InputError, unknown
from ema.core.finding import Check, Finding, Verdict
from ema.core.modes import ModalModel
from ema.core.numerics import one_blas_thread
from ema.core.references import frfs_of
from ema.identify import Identification
from ema.io.campaign.manifest import LENGTHS_M, PRESSURES_PA
from model.identifiability import AT_BOUND, IDENTIFIED
from model.tuning import TuningResult
from model.tuning_problem import CIRCUMFERENTIAL
from pipelines.process.validate import (
    RingOrder,
    amplitude_finding,
    modal_mass_kg,
    plausibility_finding,
    refuse_warnings,
    rim_frequencies_hz,
    ring_orders,
    validate,
    verdict_findings,
)
from pipelines.results.options import Options, tuning_arguments, tuning_in_force
from pipelines.results.result import TORSION, OtherMode, Result
from pipelines.results.store import load

_OF_TUNING = ("tune", "objective", "given", "tuning")
_OF_RING = (Check.AMPLITUDE, Check.PLAUSIBILITY, Check.RING)  # found again by each tuning
_LIMITS = {"mean_radius_m": LENGTHS_M, "inflation_pressure_pa": PRESSURES_PA}
_LIMITS |= {"belt_width_m": LENGTHS_M}
_FEWEST_ORDERS = 3  # that determine a ring
# The mass that the residue gives is known to this share: calibration of force and sensors.
_MASS_STD = 0.05


@one_blas_thread
def tune(result: Result, options: Options) -> Result:
    """Add ring parameters and validation to identified modes, or the reason why there are none."""
    tyre, modal_model = result.tyre, result.modal_model
    reason = _why_no_ring(tyre, modal_model, options)
    if reason or tyre is None or tyre.mean_radius_m is None or tyre.inflation_pressure_pa is None:
        return replace(result, notes=(*result.notes, reason))
    kept = tuple(f for f in result.findings if f.check not in _OF_RING)
    orders = ring_orders(modal_model)
    tuning = _tuned(tyre, modal_model, orders, result.torsions, options)
    # A rim that moves takes damping too, another mode has its own.
    used = [order for order in orders if order.order in tuning.verdict.orders_used]
    damping = model.identify_damping(
        tuning.ring,
        [order.order for order in used],
        [order.damping_ratio for order in used],
        [order.damping_std for order in used],
        pressure_load=tuning.pressure_load,
        ring_covariance=(tuning.std, tuning.covariance),
    )
    return replace(
        result,
        tuning=tuning,
        damping=damping,
        validation=validate(modal_model, orders, tuning, damping),
        findings=(*kept, *_ring_findings(modal_model, orders, tuning)),
        notes=(*result.notes, *tuning.notes, *damping.notes),
    )


def retune(
    folder: Path,
    objective: str | None = None,
    given: dict[str, float] | None = None,
    *,
    tuning: dict[str, Any] | None = None,
    strict: bool = False,
    accept_changes: bool = False,
) -> Result:
    """Load a result and tune its ring again; options that are not given stay as they were.

    Parameters
    ----------
    folder : path
        Result folder.
    objective : {"frequency", "paper"}, optional
        What the tuning minimises.
    given : dict, optional
        Ring parameters known from elsewhere, by name, in SI.
    tuning : dict, optional
        As the manifest's ``[tuning]``; overrides that of the result key by key.
    strict : bool
        Whether warnings of the result are errors.
    accept_changes : bool
        Whether to accept a result in which files were changed.

    Returns
    -------
    Result

    Raises
    ------
    InputError
        If the folder is not a result, or was changed.

    Examples
    --------
    >>> import ringmodal as rm
    >>> result = rm.retune("result", objective="paper")
    >>> result.tuning.objective
    'paper'
    """
    result = load(folder, accept_changes=accept_changes)
    if strict:
        refuse_warnings(result.findings)
    earlier = result.provenance["options"]
    options = options_of(result)
    options = replace(
        options,
        tune=True if objective is not None else options.tune,
        objective=objective or options.objective,
        given=options.given if given is None else given,
        tuning=tuning_in_force(options.tuning, tuning or {}),
    )
    chosen = {name: getattr(options, name) for name in _OF_TUNING}
    again = tune(result, options)
    return replace(again, provenance={**result.provenance, "options": {**earlier, **chosen}})


def options_of(result: Result) -> Options:
    """Options of the tuning of a stored result."""
    earlier = {"tuning": {}, **result.provenance["options"]}
    return Options(**{name: earlier[name] for name in _OF_TUNING})


def tune_ring(
    orders: ModalModel | Identification | ArrayLike,
    frequencies_hz: ArrayLike | None = None,
    **known: Any,
) -> TuningResult:
    """Tune a ring to identified modes, or to orders and frequencies.

    Parameters
    ----------
    orders : ModalModel, Identification or array_like of int, shape (n_orders,)
        Modes: their ring modes enter with their deviations, modal masses and the frequencies of the
        rim, as in `process`. Or circumferential orders, each once.
    frequencies_hz : array_like, shape (n_orders,)
        Undamped natural frequencies, for orders only.
    **known
        ``mean_radius_m`` and ``inflation_pressure_pa`` are required; all others are optional, as
        for `model.tune_ring`.

    Returns
    -------
    TuningResult

    Raises
    ------
    ParameterError
        If orders and frequencies, or what is known, cannot be used.
    InputError
        If the modes have fewer than three orders of the ring.

    Examples
    --------
    >>> import ringmodal as rm
    >>> modes = rm.load("result").modal_model
    >>> tuned = rm.tune_ring(modes, mean_radius_m=0.33, inflation_pressure_pa=2.2e5)
    >>> tuned.orders
    array([1, 2, 3, 4, 5, 6, 7, 8, 9])
    """
    _require_known(known)
    modes = orders.model if isinstance(orders, Identification) else orders
    if not isinstance(modes, ModalModel):
        if frequencies_hz is None:
            rule = "orders need frequencies"
            remedy = "Pass frequencies_hz too, or modes such as found.model"
            raise InputError("tune_ring", f"{type(orders).__name__} alone", rule, remedy)
        return model.tune_ring(modes, frequencies_hz, **known)
    ring = ring_orders(modes)
    if frequencies_hz is not None or len(ring) < _FEWEST_ORDERS:
        found = f"{len(ring)} orders of the ring" if frequencies_hz is None else "frequencies too"
        rule = f"modes need {_FEWEST_ORDERS} orders or more, and bring their frequencies"
        raise InputError("tune_ring", found, rule, "Widen the band, or pass modes alone")
    return _for_load(lambda load: model.tune_ring(**_measured(modes, ring) | known | load), known)


def _require_known(known: dict[str, Any]) -> None:
    """Refuse arguments that are missing, of another unit or unknown."""
    missing = [name for name in ("mean_radius_m", "inflation_pressure_pa") if name not in known]
    if missing:
        rule = "a ring needs radius and pressure, which set the scale"
        raise InputError("tune_ring", f"no {' and no '.join(missing)}", rule, "Add them, in SI")
    for name, (low, high) in _LIMITS.items():
        value = known.get(name)
        if isinstance(value, int | float) and value > 0 and not low <= value <= high:
            rule = f"tyres have {low:g} to {high:g}; SI units are needed"
            raise InputError(name, f"{value:g}", rule, "2.2 bar are 220000 Pa, 330 mm are 0.33 m")
    allowed = signature(model.tune_ring).parameters
    for name in known:
        if name not in allowed:
            raise unknown("tune_ring", name, "there is no such argument", allowed)


def _measured(modal_model: ModalModel, orders: Sequence[RingOrder]) -> dict[str, Any]:
    """What modes say of a ring, as arguments of `model.tune_ring`."""
    masses = [modal_mass_kg(modal_model, order) for order in orders]
    return {
        "orders": [order.order for order in orders],
        "frequencies_hz": [order.frequency_hz for order in orders],
        "frequency_std_hz": [order.frequency_std_hz for order in orders],
        "modal_mass_kg": [mass_kg for mass_kg, _ in masses],
        "modal_mass_std_kg": [std_kg for _, std_kg in masses],
        "rim_hz": rim_frequencies_hz(modal_model),
    }


def _tuned(
    tyre: Tyre,
    modal_model: ModalModel,
    orders: Sequence[RingOrder],
    torsions: Sequence[OtherMode],
    options: Options,
) -> TuningResult:
    """Tune for the tyre, to the ring modes and to the torsion modes of other sensors."""
    torsion, further = next(iter(torsions), None), torsions[1:]
    known = {
        **_measured(modal_model, orders),
        "belt_width_m": tyre.belt_width_m,
        "torsion_hz": torsion.frequency_hz if torsion else None,
        "torsion_std_hz": torsion.frequency_std_hz if torsion else 0.0,
        "rim_torsion_hz": [each.frequency_hz for each in further],
        "objective": options.objective,
        "mean_radius_m": tyre.mean_radius_m or math.nan,
        "inflation_pressure_pa": tyre.inflation_pressure_pa or math.nan,
    }

    def tuned(load: dict[str, Any]) -> TuningResult:
        chosen = tuning_arguments({**options.tuning, **load}, options.given, vars(tyre))
        return model.tune_ring(**known, **chosen)

    return _for_load(tuned, options.tuning)


def _for_load(
    tuned: Callable[[dict[str, Any]], TuningResult], chosen: Container[str]
) -> TuningResult:
    """Tune for the pressure model chosen, or for the dead load of the paper where it has a ring.

    A tyre whose frequencies a dead load reaches only with k_θ < 0 has a follower load.
    """
    found = tuned({})
    is_chosen = "pressure_load" in chosen or CIRCUMFERENTIAL in chosen
    negative = found.how[CIRCUMFERENTIAL] == AT_BOUND
    if is_chosen or found.pressure_load == "follower" or not (negative or found.verdict.against):
        return found
    other = tuned({"pressure_load": "follower"})
    if other.how[CIRCUMFERENTIAL] == AT_BOUND or not (negative or other.verdict.is_good):
        return found
    reason = "would need k_θ below zero" if negative else "fits no ring"
    note = (
        f"As a dead load the pressure {reason}: the ring is tuned for a pressure that stays normal "
        "to the belt (follower)."
    )
    return replace(other, notes=(note, *other.notes))


def _ring_findings(
    modal_model: ModalModel, orders: Sequence[RingOrder], tuning: TuningResult
) -> list[Finding]:
    """Whether ring and amplitudes are plausible, the most likely cause of a doubt first."""
    identified = tuning.how["mass_per_area_kg_m2"] == IDENTIFIED
    mass = tuning.ring.mass_per_area_kg_m2 if identified else None
    plausible = plausibility_finding(orders, mass, tuning.ring.mean_radius_m)
    doubted = plausible is not None and not plausible.is_ok
    amplitude = amplitude_finding(modal_model, orders, tuning.ring, ring_is_doubted=doubted)
    return [*([plausible] if plausible else []), *amplitude, *verdict_findings(tuning.verdict)]


def _why_no_ring(tyre: Tyre | None, modal_model: ModalModel, options: Options) -> str:
    if not options.tune:
        return "The ring steps were left out (--no-tune)."
    if tyre is None:
        return "No [tyre] in the manifest: the ring steps were left out."
    if tyre.mean_radius_m is None or tyre.inflation_pressure_pa is None:
        return "No mean radius or inflation pressure: no ring parameters can be determined."
    if not np.all(np.isfinite(modal_model.position_deg)):
        return "No [grid] in the manifest: without angles there are no orders and no ring."
    n_orders = len(ring_orders(modal_model))
    if n_orders < _FEWEST_ORDERS:
        orders = "order was" if n_orders == 1 else "orders were"
        return (
            f"Only {n_orders} circumferential {orders} identified; a ring needs three. Stiff tyres "
            "have them above 300 Hz: widen the band."
        )
    return ""


def with_other_modes(
    result: Result, campaign: Campaign, band_hz: tuple[float, float], estimator: str
) -> Result:
    """The result with the modes of each other direction, and what was done about their mass."""
    for other in campaign.others:
        part = replace(other, processing=campaign.processing)
        try:
            frf = frfs_of(ema.estimate_frf(part, estimator=estimator))[0]
            model = ema.identify_modes(
                frf, band_hz, settings=campaign.identification, checks=campaign.checks
            ).model
        except (FitError, InputError) as error:
            detail = f"no modes of {other.direction} sensors: {error}"
            finding = Finding("", "", None, Check.DIRECTION, Verdict.WARNING, detail)
            result = replace(result, findings=(*result.findings, finding))
            continue
        modes, notes = tuple(_other_modes(part, model)), tuple(_notes(part))
        result = replace(
            result, other_modes=(*result.other_modes, *modes), notes=(*result.notes, *notes)
        )
    if (torsion := result.torsion) is not None:
        damping = f"{100 * torsion.damping_ratio:.2f} %"
        note = f"Torsion at {torsion.frequency_hz:.2f} Hz with damping {damping}."
        result = replace(result, notes=(*result.notes, note))
    return result


def _other_modes(campaign: Campaign, model: ModalModel) -> Iterator[OtherMode]:
    for mode in model.modes:
        found = OtherMode(
            campaign.direction,
            campaign.force_direction,
            mode.frequency_hz,
            mode.frequency_std_hz,
            mode.damping_ratio,
            mode.damping_std,
            mode.order,
            mode.order_purity,
            model.position_deg.size,
        )
        yield found if found.name != TORSION else _bare(found, campaign, mode.residues)


def _bare(torsion: OtherMode, campaign: Campaign, residues: np.ndarray) -> OtherMode:
    """Torsion without the masses on the tyre, which all move alike in it.

    The residue of a force in the same direction is 1/(2ωM), with M of the tyre and all masses.
    """
    hung_kg = np.mean([_hung_kg(campaign, run) for run in campaign.runs])
    if campaign.force_direction != Direction.TANGENTIAL or not hung_kg:
        return torsion
    total_kg = 1 / (4 * np.pi * torsion.frequency_hz * np.abs(residues.mean()))
    if not total_kg > 2 * hung_kg:  # no mass of a tyre
        return torsion
    factor = float(np.sqrt(total_kg / (total_kg - hung_kg)))
    spread = _MASS_STD * (factor - 1)
    return replace(
        torsion,
        frequency_hz=factor * torsion.frequency_hz,
        frequency_std_hz=float(np.hypot(torsion.frequency_std_hz, spread * torsion.frequency_hz)),
        damping_ratio=factor * torsion.damping_ratio,
        damping_std=float(np.hypot(torsion.damping_std, spread * torsion.damping_ratio)),
    )


def _hung_kg(campaign: Campaign, run: Run) -> float:
    """Mass of all sensors and at the load cell; a sensor of several directions counts once."""
    by_place = {
        each.channel.name if each.position_deg is None else each.position_deg: each
        for each in (*run.responses, *run.others)
    }
    sensors = (campaign.mass_of(each.channel.name) or 0.0 for each in by_place.values())
    return sum(sensors) + (campaign.live_mass_kg or 0.0)


def _notes(campaign: Campaign) -> Iterator[str]:
    direction, force = campaign.direction, campaign.force_direction
    yield f"Modes of {direction} sensors and a {force} force are in other_modes.csv."
    if campaign.stated_mass_kg is None:
        yield f"Sensor mass not given: the modes of {direction} sensors are not corrected for it."
    else:
        but = " but the torsion" if direction == force == Direction.TANGENTIAL else ""
        yield f"The mass of sensors is not compensated in the modes of {direction} sensors{but}."
