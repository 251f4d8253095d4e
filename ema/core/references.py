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

# A sensor within this angle is at the place of the force.
_SAME_PLACE_DEG = 0.01


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

    def common_rows(self) -> tuple[FRF, ...]:
        """FRFs of each force at the places that all of them have, in the order of the first one.

        Raises
        ------
        InputError
            If they have no place in common.
        """
        rows = self.shared_rows()
        if all(
            np.array_equal(own, np.arange(frf.n_positions))
            for own, frf in zip(rows, self.frfs, strict=True)
        ):
            return self.frfs
        return tuple(frf.rows(own) for frf, own in zip(self.frfs, rows, strict=True))

    def shared_rows(self) -> list[NDArray[np.int_]]:
        """Rows of each force at the places that all of them have, in the order of the first one.

        Raises
        ------
        InputError
            If they have no place in common.
        """
        places = [_places(frf) for frf in self.frfs]
        shared = [place for place in places[0] if all(place in other for other in places[1:])]
        if not shared:
            rule = "several forces are identified together at the places that all of them have"
            remedy = "Identify each force by itself"
            raise InputError("references", "no place in common", rule, remedy)
        return [np.array([own[place] for place in shared]) for own in places]

    def cmif(self) -> NDArray[np.float64]:
        """Complex mode indicator function: singular values of the matrix of FRFs, largest first.

        As many of its curves peak at a resonance as modes answer there (Shih, Tsuei, Allemang &
        Brown 1988).

        Returns
        -------
        ndarray, shape (n_forces, n_frequencies)
            In (m/s²)/N.

        Examples
        --------
        >>> import ringmodal as rm
        >>> folder = rm.simulate_campaign("for_cmif", duration_s=2.0, force_deg=(0.0, 22.5))
        >>> largest, second = rm.estimate_frf(rm.read_campaign(folder)).cmif()
        >>> bool(largest.max() > second.max())
        True
        """
        return cmif_of(self._by_line())

    def mif(self) -> NDArray[np.float64]:
        """Multivariate mode indicator function: 1 off resonance, towards 0 at one.

        The share of the response in phase with the best real combination of the forces; the
        second curve falls with the first one where two modes answer (Williams, Crowley & Vold
        1985).

        Returns
        -------
        ndarray, shape (n_forces, n_frequencies)
            Smallest first.

        Examples
        --------
        >>> import ringmodal as rm
        >>> folder = rm.simulate_campaign("for_mif", duration_s=2.0, force_deg=(0.0, 22.5))
        >>> lowest, second = rm.estimate_frf(rm.read_campaign(folder)).mif()
        >>> bool((lowest <= second).all())
        True
        """
        return mif_of(self._by_line())

    def _by_line(self) -> NDArray[np.complex128]:
        """Matrix of FRFs line by line, (n_frequencies, n_positions, n_forces)."""
        return np.stack([frf.values.T for frf in self.common_rows()], axis=2)

    def as_stored(self) -> References:
        """The same with coherence and σ rounded as `FRF.as_stored` does."""
        return replace(self, frfs=tuple(frf.as_stored() for frf in self.frfs))

    @property
    def frequency_hz(self) -> NDArray[np.float64]:
        """Frequency lines."""
        return self.frfs[0].frequency_hz


def cmif_of(values: NDArray[np.complex128]) -> NDArray[np.float64]:
    """`References.cmif` of FRFs line by line, (n_frequencies, n_positions, n_forces)."""
    return np.asarray(np.linalg.svd(values, compute_uv=False).T)


def mif_of(values: NDArray[np.complex128]) -> NDArray[np.float64]:
    """`References.mif` of the same."""
    real, imag = (part.swapaxes(1, 2) @ part for part in (values.real, values.imag))
    whole = real + imag
    size = np.trace(whole, axis1=1, axis2=2)
    unit = np.eye(whole.shape[1]) * np.where(size > 0, 1e-12 * size, 1.0)[:, None, None]
    root = np.linalg.inv(np.linalg.cholesky(whole + unit))
    return np.asarray(np.linalg.eigvalsh(root @ real @ root.swapaxes(1, 2)).clip(0, 1).T)


def _places(frf: FRF) -> dict[tuple[float, ...], int]:
    """Row of each place: angle or node, and direction."""
    angles = np.where(np.isfinite(frf.position_deg), np.round(frf.position_deg, 6), -1.0)
    keys = zip(frf.node.tolist(), angles.tolist(), frf.axis.tolist(), strict=True)
    return {key: row for row, key in enumerate(keys)}


def driving_point(frf: FRF) -> tuple[int, int] | None:
    """Row at the place of the force and along it, and the sign of its direction; None without."""
    away = np.abs((frf.position_deg - frf.excitation_deg + 180.0) % 360.0 - 180.0)
    at = np.flatnonzero(away < _SAME_PLACE_DEG)
    if not np.any(np.isfinite(away)) and frf.force_node > 0:
        axis, force_axis = np.abs(frf.axis), abs(frf.force_axis)
        along = (axis == force_axis) | (axis == 0) | (force_axis == 0)
        at = np.flatnonzero((frf.node == frf.force_node) & along)
    if at.size != 1:
        return None
    row = int(at[0])
    return row, int(np.sign(frf.axis[row] or 1) * np.sign(frf.force_axis or 1))


def mapped(found: FRF | References, change: Callable[[FRF], FRF]) -> FRF | References:
    """FRFs of one force or of several, each changed."""
    if isinstance(found, FRF):
        return change(found)
    return replace(found, frfs=tuple(change(frf) for frf in found))


def frfs_of(found: FRF | References) -> tuple[FRF, ...]:
    """FRFs of each force, one after the other."""
    return (found,) if isinstance(found, FRF) else found.frfs
