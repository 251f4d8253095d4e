"""FRFs of one structure against several forces, each at a place and in a direction of its own."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ema.core.display import counted
from ema.core.errors import InputError
from ema.core.frf import FRF
from ema.core.numerics import ReadonlyArrays


@dataclass(frozen=True, eq=False)
class References(ReadonlyArrays):
    """FRFs of one structure against several references, on the same frequency lines.

    Parameters
    ----------
    frfs : tuple of FRF
        One for each force: `FRF.excitation_deg`, `FRF.force_node` and `FRF.force_axis` say where.
    condition : ndarray, shape (n_frequencies,)
        Condition number of the spectral matrix of the forces, scaled to ones on its diagonal, where
        they acted at the same time; empty where each acted alone.
    multiple_coherence : ndarray, shape (n_positions, n_frequencies)
        Of each response with all forces; empty where each acted alone.

    Raises
    ------
    InputError
        If there is no FRF, or frequency lines differ.

    Examples
    --------
    >>> import ringmodal as rm
    >>> folder = rm.simulate_campaign("two_places", duration_s=2.0, force_deg=(0.0, 22.5))
    >>> references = rm.estimate_frf(rm.read_campaign(folder))
    >>> references
    <References: 2 forces at 0°, 22.5°>
    >>> [frf.excitation_deg for frf in references]
    [0.0, 22.5]
    """

    frfs: tuple[FRF, ...]
    condition: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    multiple_coherence: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 0)))

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.frfs:
            raise InputError("references", "none", "there must be at least one", "Pass an FRF")
        lines = self.frfs[0].frequency_hz
        for number, frf in enumerate(self.frfs[1:], start=2):
            if not np.array_equal(frf.frequency_hz, lines):
                found = f"{frf.frequency_hz.size} lines for {lines.size} of the first one"
                rule = "all must have the same frequency lines"
                remedy = "Estimate them with the same block length"
                raise InputError(f"reference {number}", found, rule, remedy)

    def __repr__(self) -> str:
        places = (frf.excitation_deg for frf in self.frfs)
        nodes = (f"node {frf.force_node}" for frf in self.frfs)
        at = (
            f"{place:g}°" if np.isfinite(place) else node
            for place, node in zip(places, nodes, strict=True)
        )
        return f"<References: {counted(len(self), 'force')} at {', '.join(at)}>"

    def __len__(self) -> int:
        return len(self.frfs)

    def __iter__(self) -> Iterator[FRF]:
        return iter(self.frfs)

    def as_stored(self) -> References:
        """The same with coherence and σ rounded as `FRF.as_stored` does."""
        return replace(self, frfs=tuple(frf.as_stored() for frf in self.frfs))

    @property
    def frequency_hz(self) -> NDArray[np.float64]:
        """Frequency lines."""
        return self.frfs[0].frequency_hz


def mapped(found: FRF | References, change: Callable[[FRF], FRF]) -> FRF | References:
    """FRFs of one force or of several, each changed."""
    if isinstance(found, FRF):
        return change(found)
    return replace(found, frfs=tuple(change(frf) for frf in found))


def frfs_of(found: FRF | References) -> tuple[FRF, ...]:
    """FRFs of each force, one after the other."""
    return (found,) if isinstance(found, FRF) else found.frfs
