"""The truth of a laboratory campaign: exact modes, as objects and as ``truth.json``."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from model.parameters import RingDamping, RingParameters
from pipelines.simulate.campaign import POSITIONS
from pipelines.simulate.laboratory_effects import Effects
from pipelines.simulate.laboratory_tyre import LaboratoryTyre
from pipelines.simulate.truth import Complexes, System

TRUTH_DEG = np.arange(POSITIONS) * 360.0 / POSITIONS
HIGHEST_TRUTH_HZ = 600.0
_SAME_POLE = 1e-7  # relative distance below which two poles are one


@dataclass(frozen=True, eq=False)
class LaboratoryMode:
    """A mode of the truth.

    Parameters
    ----------
    kind : str
        ``"ring"``, ``"torsion"``, ``"extensional"``, ``"rim"``, ``"lateral"`` or ``"cavity"``.
    order : int
        Circumferential order that has most of the radial shape.
    purity : float
        Share of that order in the power of the radial shape.
    energy_share : float
        Share of the kinetic energy in the coordinates that name the kind.
    frequency_hz, damping_ratio : float
        Undamped frequency and damping ratio of the pole.
    strength : float
        φ² at the force over the modal mass, 1/kg: what the force drives and a sensor there sees.
    shape : ndarray of complex, shape (72,)
        Residues at 0°, 5° … 355°, scaled to a largest magnitude of 1.
    """

    kind: str
    order: int
    purity: float
    energy_share: float
    frequency_hz: float
    damping_ratio: float
    strength: float
    shape: Complexes

    @property
    def pole(self) -> complex:
        """Pole in rad/s."""
        size = 2 * np.pi * self.frequency_hz
        return complex(-self.damping_ratio, np.sqrt(1 - self.damping_ratio**2)) * size


@dataclass(frozen=True, eq=False)
class Truth:
    """What a campaign was made from.

    Parameters
    ----------
    effects : Effects
    ring, damping : RingParameters, RingDamping
        Means around the circumference.
    force_deg : float
        Where the force really acts.
    modes : tuple of LaboratoryMode
        Of the bare tyre in the state of the first run half-way through.
    as_tested : tuple of LaboratoryMode
        The same with sensors and live mass of the first run.
    runs_percent : tuple of float
        Mean shift of the ring modes of each run against the first, percent.
    """

    effects: Effects
    ring: RingParameters
    damping: RingDamping
    force_deg: float
    modes: tuple[LaboratoryMode, ...]
    as_tested: tuple[LaboratoryMode, ...]
    runs_percent: tuple[float, ...]


def modes_of(tyre: LaboratoryTyre, system: System, force_deg: float) -> tuple[LaboratoryMode, ...]:
    """Modes of a system up to `HIGHEST_TRUTH_HZ`; poles that coincide are one mode."""
    residues = system.residues(tyre.surface(np.append(TRUTH_DEG, force_deg)))
    poles = system.poles[np.abs(system.poles) < 2 * np.pi * HIGHEST_TRUTH_HZ]
    apart = np.abs(poles[1:] / poles[:-1] - 1) >= _SAME_POLE
    return tuple(
        _mode(tyre, poles[same[0]], system.vectors[:, same[0]], residues[:, same].sum(axis=1))
        for same in np.split(np.arange(poles.size), np.flatnonzero(apart) + 1)
    )


def _mode(
    tyre: LaboratoryTyre, pole: complex, vector: Complexes, residues: Complexes
) -> LaboratoryMode:
    kind, share = _kind(tyre, vector)
    shape = residues[:-1] / np.abs(residues[:-1]).max()
    lines = np.abs(np.fft.fft(shape)) ** 2
    power = np.bincount(np.abs(np.fft.fftfreq(POSITIONS, 1 / POSITIONS)).astype(int), lines)
    order = int(np.argmax(power))
    purity, size = float(power[order] / power.sum()), float(abs(pole))
    strength = float(2 * size * abs(residues[-1]))
    of_pole = size / (2 * np.pi), float(-pole.real / size)
    return LaboratoryMode(kind, order, purity, share, *of_pole, strength, shape)


def _kind(tyre: LaboratoryTyre, vector: Complexes) -> tuple[str, float]:
    """What moves most, and its share of the kinetic energy."""
    energy = np.real(vector.conj() * (tyre.mass @ vector))
    shares: dict[str, float] = {}
    for (kind, order), part in zip(tyre.labels, energy, strict=True):
        belt = kind in ("radial", "tangential")
        turns = kind == "turning" or (kind == "tangential" and order == 0)
        name = "torsion" if turns else f"ring {order}" if belt else kind
        shares[name] = shares.get(name, 0.0) + float(part)
    name = max(shares, key=lambda key: shares[key])
    share = shares[name] / sum(shares.values())
    if not name.startswith("ring"):
        return name, share
    extended = tyre.extension_share(vector)
    return ("extensional" if extended > 0.5 and name != "ring 0" else "ring"), share


def truth_content(truth: Truth) -> dict[str, Any]:
    """Content of ``truth.json``."""
    effects = truth.effects
    return {
        "schema": 1,
        "seed": effects.seed,
        "options": {k: v for k, v in effects.switched_on.items() if k != "seed"},
        "tyre": asdict(truth.ring) | asdict(truth.damping),
        "force_deg": truth.force_deg,
        "modes": [_mode_content(mode) for mode in truth.modes],
        "as_tested_first_run": [_mode_content(mode) for mode in truth.as_tested],
        "runs_percent": list(truth.runs_percent),
    }


def _mode_content(mode: LaboratoryMode) -> dict[str, Any]:
    content = asdict(mode)
    shape = content.pop("shape")
    return content | {"re": np.round(shape.real, 12).tolist(), "im": shape.imag.round(12).tolist()}
