"""Modes that tangential and axial sensors show, beside those of the ring."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

import ema
from ema.core.campaign import Campaign, Direction, Run
from ema.core.errors import FitError, InputError
from ema.core.finding import Check, Finding, Verdict
from ema.core.modes import ModalModel
from pipelines.results.result import TORSION, OtherMode, Result

# The mass that the residue gives is known to this share: calibration of force and sensors.
_MASS_STD = 0.05


def with_other_modes(
    result: Result, campaign: Campaign, band_hz: tuple[float, float], estimator: str
) -> Result:
    """The result with the modes of each other direction, and what was done about their mass."""
    for other in campaign.others:
        part = replace(other, processing=campaign.processing)
        try:
            frf = ema.estimate_frf(part, estimator=estimator)
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
