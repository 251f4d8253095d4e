"""The tyre that a simulation is about: a parameter set, or the one that comes as sample."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ema.core.errors import InputError
from model.errors import ParameterError
from model.parameters import RingDamping, RingParameters, Wheel
from model.reference import DESIGNATION, TABLE_4_RING, TABLE_5_DAMPING
from pipelines.library.library import read_source


@dataclass(frozen=True)
class SimulatedTyre:
    """A tyre ready for the model.

    Parameters
    ----------
    name : str
        How messages call it.
    ring : RingParameters
    damping : RingDamping or None
        None where the parameter set holds none.
    wheel : Wheel or None
        None where the parameter set holds none.
    """

    name: str
    ring: RingParameters
    damping: RingDamping | None = None
    wheel: Wheel | None = None


def tyre_to_simulate(path: Path | None, *, accept_changes: bool = False) -> SimulatedTyre:
    """The tyre of a parameter set or result folder; without one the sample (Tables 4 and 5).

    A file may be edited at will; a result folder must be as it was written.

    Raises
    ------
    InputError
        If there is no parameter set, or its values make no ring.
    """
    if path is None:
        return SimulatedTyre(f"the sample tyre {DESIGNATION}", TABLE_4_RING, TABLE_5_DAMPING)
    found = read_source(path, accept_changes=accept_changes, lone=False)
    try:
        return SimulatedTyre(
            str(path), found.ring_parameters, found.ring_damping, found.wheel_parameters
        )
    except ParameterError as error:
        raise InputError(f"{path}, {error.where}", error.found, error.rule, error.remedy) from error


def damping_of(tyre: SimulatedTyre, *, on_pretension: bool = True) -> RingDamping:
    """Damping of a tyre, which forced vibration needs.

    Parameters
    ----------
    tyre : SimulatedTyre
    on_pretension : bool
        Whether the loss factor acts on the stiffness from hoop tension too.

    Raises
    ------
    InputError
        If its parameter set has none.
    """
    if tyre.damping is None:
        raise InputError(
            tyre.name,
            "no section [damping]",
            "forced vibration needs damping",
            "Add radial_n_s_m3, circumferential_n_s_m3 and loss_factor",
        )
    damping = tyre.damping
    return RingDamping(
        damping.radial_n_s_m3, damping.circumferential_n_s_m3, damping.loss_factor, on_pretension
    )
