"""A ring out of a tyre property file: what it holds of one, and what has to be assumed."""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass
from datetime import UTC, datetime

from ema.core.errors import InputError
from model.errors import ParameterError
from model.foundation import Foundation, foundation_from_belt_modes
from model.tuning_problem import BENDING, TYPICAL
from pipelines.export.tir_belt import require_belt_width
from pipelines.export.tir_file import TirFile
from pipelines.export.tir_units import TirUnits, clear_si_value, positive_si_value, units_of
from pipelines.export.tir_update import unit_notes
from pipelines.results.parameter_set import Parameter, ParameterSet
from pipelines.results.provenance import software_version

_ASSUMED = "not identified"


@dataclass(frozen=True)
class RingFromTir:
    """A parameter set out of a tyre property file.

    Parameters
    ----------
    parameters : ParameterSet
        Without damping: two damping ratios do not determine three parameters.
    notes : tuple of str
        What a reader must know, in sentences.
    """

    parameters: ParameterSet
    notes: tuple[str, ...]


def ring_from_tir(
    tir: TirFile, width_m: float | None = None, like: ParameterSet | None = None
) -> RingFromTir:
    """Find a, ρh, k_r and k_θ in a tyre property file; the inverse of an update.

    Parameters
    ----------
    tir : TirFile
        With BELT_MASS, BELT_IYY, FREQ_LONG, FREQ_WINDUP and INFLPRES.
    width_m : float, optional
        Belt width b, m. Default: that of `like`.
    like : ParameterSet, optional
        Gives K and D, which are not in such a file. Default: K from the growth on inflation that
        is typical (eq 16), D of a typical tyre.

    Raises
    ------
    InputError
        If a value is missing or no number, the width is not known, or no ring has these values.
    """
    units = units_of(tir)
    width = _width(tir, units, width_m, like)
    mass, inertia, translation, torsion, pressure = (
        positive_si_value(tir, units, key)
        for key in ("BELT_MASS", "BELT_IYY", "FREQ_LONG", "FREQ_WINDUP", "INFLPRES")
    )
    radius = math.sqrt(inertia / mass)
    per_area = mass / (2 * math.pi * radius * width)
    try:
        found = foundation_from_belt_modes(
            translation,
            torsion,
            mean_radius_m=radius,
            mass_per_area_kg_m2=per_area,
            inflation_pressure_pa=pressure,
            axial_stiffness_n_m=like.ring["axial_stiffness_n_m"].value if like else None,
        )
    except ParameterError as error:
        raise InputError(
            f"{tir.name}, {error.where}", error.found, error.rule, error.remedy
        ) from error
    parameters = ParameterSet(
        designation=tir.name.rpartition(".")[0] or tir.name,
        conditions={"inflation_pressure_pa": pressure},
        ring={
            "mean_radius_m": Parameter(radius),
            "belt_width_m": Parameter(width),
            "mass_per_area_kg_m2": Parameter(per_area),
            "radial_stiffness_n_m3": Parameter(found.radial_stiffness_n_m3),
            "circumferential_stiffness_n_m3": Parameter(found.circumferential_stiffness_n_m3),
            **_belt_stiffness(found, like),
        },
        provenance=_provenance(tir),
    )
    return RingFromTir(parameters, tuple(_notes(tir, units, radius, like)))


def _width(
    tir: TirFile, units: TirUnits, width_m: float | None, like: ParameterSet | None
) -> float:
    if width_m is None and like and "belt_width_m" in like.ring:
        return like.ring["belt_width_m"].value
    if width_m is None:
        outline = clear_si_value(tir, units, "WIDTH")
        hint = f"; its WIDTH of {outline:g} m is that of the whole section" if outline else ""
        raise InputError(
            tir.name, "no belt width", f"such a file does not hold it{hint}", "Give --belt-width-m"
        )
    require_belt_width(width_m)
    return width_m


def _belt_stiffness(found: Foundation, like: ParameterSet | None) -> dict[str, Parameter]:
    names = ("axial_stiffness_n_m", "bending_stiffness_n_m")
    if like:
        return {name: like.ring[name] for name in names}
    values = found.axial_stiffness_n_m, TYPICAL[BENDING]
    return {name: Parameter(value, _ASSUMED) for name, value in zip(names, values, strict=True)}


def _provenance(tir: TirFile) -> dict[str, str]:
    return {
        "software": f"ringmodal {software_version()}",
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "source": tir.name,
        "source_sha256": hashlib.sha256(tir.content).hexdigest(),
    }


def _notes(tir: TirFile, units: TirUnits, radius: float, like: ParameterSet | None) -> list[str]:
    missing = "K and D are not in such a file: "
    notes = [
        f"{missing}they are taken from the set given with --like."
        if like
        else f"{missing}K follows from the growth on inflation that is typical, D is that of a "
        "typical tyre. k_r and k_θ depend on K a little; --like SET takes K and D from a set.",
        "Damping is not taken over: two damping ratios do not determine three parameters.",
    ]
    outer = clear_si_value(tir, units, "UNLOADED_RADIUS")
    if outer and not 0.8 <= radius / outer <= 1.0:
        notes.append(
            f"The belt's radius √(BELT_IYY/BELT_MASS) is {radius:.3f} m, the tyre's "
            f"UNLOADED_RADIUS {outer:.3f} m: check both belt values."
        )
    return notes + unit_notes(units)
