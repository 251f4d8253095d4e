"""Drive-point check: position and polarity of the force against the mode shapes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ema.circumference.orders import on_circle, order_content
from ema.core.finding import Check, Finding, Verdict
from ema.core.modes import ModalModel
from ema.core.settings import CHECKS, CheckSettings

_FEWEST_ORDERS = 3
_STEP_DEG = 0.5


def drive_point_finding(
    model: ModalModel, excitation_deg: float | None, settings: CheckSettings = CHECKS
) -> list[Finding]:
    """Compare where the shapes are driven from with where the force is said to be.

    Where a structure is driven every mode answers in phase with the force: −Im of the residue is
    positive in all orders (a point mobility has a positive real part). An order of a ring, both
    members together, is there at the crest of its wave; so the place shows in the shapes.

    Parameters
    ----------
    model : ModalModel
    excitation_deg : float or None
        Where the manifest says that the force acts.
    settings : CheckSettings

    Returns
    -------
    list of Finding
        Nothing where it cannot be judged: no circle, or fewer than three orders.
    """
    if excitation_deg is None or not on_circle(model.position_deg):
        return []
    waves = _waves(model)
    if len(waves) < _FEWEST_ORDERS:
        return []
    clear = settings.drive_point_clear
    here = float(_agreement(waves, np.array([excitation_deg]))[0])
    if here < -clear:
        says = (
            "all shapes move against the force where it acts: force or accelerations have the "
            "wrong sign in all runs. Frequencies and damping are right, FRFs and residues turned"
        )
        return [_finding(excitation_deg, Verdict.WARNING, says)]
    angles = np.arange(0.0, 360.0, _STEP_DEG)
    score = _agreement(waves, angles)
    best = int(np.argmax(np.abs(score)))
    elsewhere = abs(score[best]) > clear
    away_deg = abs((angles[best] - excitation_deg + 180) % 360 - 180)
    off = away_deg > settings.drive_point_offset_deg
    off = off and 1 - here > settings.position_factor * (1 - abs(score[best]))
    if (here > clear and not off) or (here > settings.drive_point_agrees and not elsewhere):
        says = "the shapes are driven from where the force acts"
        return [_finding(excitation_deg, Verdict.OK, says)]
    says = "the shapes are not driven from there"
    remedy = "Check [excitation] position_deg and the positions of the sensors"
    if elsewhere:
        turned = ", by a force of the other sign" if score[best] < 0 else ""
        says += f" but from about {angles[best]:g}°{turned}"
        remedy = (
            f"If the force acts there, [excitation] position_deg = {angles[best]:g}; otherwise "
            "check the positions of the sensors"
        )
    return [_finding(excitation_deg, Verdict.WARNING, f"{says}. {remedy}")]


def _finding(position_deg: float, verdict: Verdict, detail: str) -> Finding:
    return Finding("", "force", position_deg, Check.DRIVE_POINT, verdict, detail)


def _waves(model: ModalModel) -> dict[int, tuple[float, float]]:
    """−Im of the residues of each order n ≥ 1 as amplitudes of cos nθ and sin nθ."""
    waves: dict[int, tuple[float, float]] = {}
    for mode in model.modes:
        if not mode.order:
            continue
        content = order_content(-mode.residues.imag.astype(complex), model.position_deg)
        cosine, sine = waves.get(mode.order, (0.0, 0.0))
        waves[mode.order] = (
            cosine + float(content.cosine[mode.order].real),
            sine + float(content.sine[mode.order].real),
        )
    return waves


def _agreement(
    waves: dict[int, tuple[float, float]], angles_deg: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Mean over the orders of the response at an angle over the crest of its wave, −1 … 1."""
    orders = np.array(list(waves))
    cosine, sine = np.array(list(waves.values())).T
    phase = np.outer(np.deg2rad(angles_deg), orders)
    return np.asarray(
        np.mean((cosine * np.cos(phase) + sine * np.sin(phase)) / np.hypot(cosine, sine), axis=1)
    )
