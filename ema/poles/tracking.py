"""Pole tracking over model orders and clustering."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from ema.core.errors import InputError
from ema.core.mac import mac
from ema.core.numerics import ReadonlyArrays
from ema.core.settings import IDENTIFICATION, IdentificationSettings
from ema.poles.estimators import driven_poles_of_order, shapes_of_poles

# A cluster in this share of the orders, and in all since its first, is no chance.
_LASTING = 0.25
# A cluster has ended where others begin if this share of its poles lies below.
_ENDED = 0.8
# Of poles within this share of their half-width, several forces tell the plane of the shapes only.
_TOGETHER = 0.3
# Shapes span no more than others where this share of their power is all that they add: rounding.
_ONE_SHAPE = 1e-12


@dataclass(frozen=True, eq=False)
class PoleHistory:
    """Poles of all orders, (n_poles,), with shapes and their match in the order before."""

    model_order: NDArray[np.int_]
    poles: NDArray[np.complex128]
    shapes: NDArray[np.complex128]  # (n_poles, n_positions)
    step_frequency: NDArray[np.float64]  # relative change from the match; inf where there is none
    step_damping: NDArray[np.float64]  # the same of the damping ratio
    step_total: NDArray[np.float64]  # |Δλ|/max|λ| + 1 − MAC to the match; inf where there is none
    match: NDArray[np.int_]  # index of the match; −1 where there is none
    # (n_poles, n_forces), the largest of each pole 1; empty where nobody asks
    participation: NDArray[np.complex128] = field(default_factory=lambda: np.zeros((0, 0), complex))


def pole_history(
    matrix: NDArray[np.complex128],
    piece: NDArray[np.complex128],
    step_s: float,
    lowest_hz: float,
    max_damping: float,
) -> PoleHistory:
    """Solve all model orders of one normal matrix and follow the stable poles through them.

    `matrix` is that of the highest order; `piece`, ([n_forces,] n_positions, n_samples), the
    impulse responses that give the shapes. Poles damped more than `max_damping` are not worth
    following.
    """
    rows: list[tuple[NDArray[np.generic], ...]] = []
    n_forces = len(piece) if piece.ndim > 2 else 1
    old_poles = np.zeros(0, dtype=complex)
    old_shapes = np.zeros((0, piece.shape[-2]), dtype=complex)
    first_old = 0
    for order in range(2, len(matrix) // n_forces):
        poles, drives = driven_poles_of_order(matrix, order, step_s, lowest_hz, n_forces)
        damping = -poles.real / np.abs(poles)
        kept = (damping > 0) & (damping < max_damping) & (poles.imag > 0)
        poles, drives = poles[kept], drives[kept]
        of_forces = drives if piece.ndim > 2 else None
        shapes = shapes_of_poles(piece, poles, step_s, lowest_hz, of_forces)
        match, total = _matches(old_poles, old_shapes, poles, shapes, planes=n_forces > 1)
        frequency, ratio = _changes(old_poles, poles, match)
        global_match = np.where(match >= 0, match + first_old, -1)
        rows.append(
            (
                np.full(poles.size, order),
                poles,
                shapes,
                frequency,
                ratio,
                total,
                global_match,
                drives,
            )
        )
        first_old += old_poles.size
        old_poles, old_shapes = poles, shapes
    return PoleHistory(*(np.concatenate(column) for column in zip(*rows, strict=True)))


def _matches(
    old_poles: NDArray[np.complex128],
    old_shapes: NDArray[np.complex128],
    poles: NDArray[np.complex128],
    shapes: NDArray[np.complex128],
    *,
    planes: bool,
) -> tuple[NDArray[np.int_], NDArray[np.float64]]:
    """Match of each pole in the order before, one to one, and the distance to it.

    Only mutual nearest neighbours match. Shapes count as much as poles, so that the two members of
    a pair are not mistaken for each other where they lie close together. Where `planes` are
    compared, shapes of poles that coincide may turn within the plane that they have in common.
    """
    match, total = np.full(poles.size, -1), np.full(poles.size, np.inf)
    if not (old_poles.size and poles.size):
        return match, total
    alike = mac(old_shapes, shapes)
    distance = _apart(old_poles, poles) + 1 - alike
    for k, found in _mac_to_planes(old_poles, old_shapes, shapes) if planes else ():
        distance[k] += alike[k] - found
    # What is left after the nearest were matched may be the other pole in the same place.
    for _ in range(2 if planes else 1):
        nearest_old, nearest_new = distance.argmin(axis=0), distance.argmin(axis=1)
        mutual = np.flatnonzero(nearest_new[nearest_old] == np.arange(poles.size))
        mutual = mutual[np.isfinite(distance[nearest_old[mutual], mutual])]
        match[mutual] = nearest_old[mutual]
        total[mutual] = distance[nearest_old[mutual], mutual]
        distance[nearest_old[mutual]] = np.inf
        distance[:, mutual] = np.inf
    return match, total


def _mac_to_planes(
    poles: NDArray[np.complex128], shapes: NDArray[np.complex128], others: NDArray[np.complex128]
) -> Iterator[tuple[int, NDArray[np.float64]]]:
    """Poles that coincide with others, and the MAC of other shapes to the plane of theirs."""
    width = np.minimum.outer(-poles.real, -poles.real)
    together = np.abs(poles[:, None] - poles) < _TOGETHER * width
    np.fill_diagonal(together, True)
    several = np.flatnonzero(np.sum(together, axis=1) > 1)
    if not several.size:
        return
    unit, rest = (each / np.linalg.norm(each, axis=1)[:, None] for each in (shapes, others))
    inner, seen = unit.conj() @ unit.T, unit.conj() @ rest.T
    for k in several:
        group = np.flatnonzero(together[k])
        powers, axes = np.linalg.eigh(inner[np.ix_(group, group)])
        spanned = powers > _ONE_SHAPE * powers[-1]
        along = axes[:, spanned].conj().T @ seen[group] / np.sqrt(powers[spanned])[:, None]
        yield int(k), np.sum(np.abs(along) ** 2, axis=0)


def _distance(poles: NDArray[np.complex128], shapes: NDArray[np.complex128]) -> NDArray[np.float64]:
    """|Δλ|/max|λ| + 1 − MAC of every two poles, (n_poles, n_poles)."""
    return _apart(poles, poles) + 1 - mac(shapes, shapes)


def _apart(first: NDArray[np.complex128], second: NDArray[np.complex128]) -> NDArray[np.float64]:
    """|Δλ|/max|λ| of every pair, (n_first, n_second)."""
    largest = np.maximum.outer(np.abs(first), np.abs(second))
    return np.asarray(np.abs(first[:, None] - second) / largest)


def _changes(
    old_poles: NDArray[np.complex128], poles: NDArray[np.complex128], match: NDArray[np.int_]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Relative change of frequency and of damping ratio from the matches."""
    frequency, damping = np.full(poles.size, np.inf), np.full(poles.size, np.inf)
    new = np.flatnonzero(match >= 0)
    old = old_poles[match[new]]
    frequency[new] = np.abs(np.abs(poles[new]) / np.abs(old) - 1)
    ratio = (poles[new].real / np.abs(poles[new])) / (old.real / np.abs(old))
    damping[new] = np.abs(ratio - 1)
    return frequency, damping


@dataclass(frozen=True)
class Cluster:
    """Poles of many model orders that belong together."""

    label: int  # number used in `StabilityDiagram.cluster`
    pole: complex  # representative pole in rad/s
    size: int  # number of model orders that contain it
    kept: bool  # whether it is taken for a mode
    reason: str  # why it was kept or dropped, in words

    @property
    def frequency_hz(self) -> float:
        """Undamped frequency |s|/2π."""
        return abs(self.pole) / (2 * np.pi)

    @property
    def damping_ratio(self) -> float:
        """Damping ratio −Re(s)/|s|."""
        return -self.pole.real / abs(self.pole)


@dataclass(frozen=True, eq=False)
class PoleSelection(ReadonlyArrays):
    """Poles that start a curve fit."""

    poles: NDArray[np.complex128]  # rad/s; poles outside the band guard its ends
    band_hz: tuple[float, float]  # band whose modes are wanted
    pinned: bool = False  # whether it is these poles and no others: none is added, none dropped

    @classmethod
    def around(cls, poles: ArrayLike) -> PoleSelection:
        """Select given poles and a band that reaches 20 % beyond them."""
        try:
            given = np.atleast_1d(np.asarray(poles, dtype=complex)).ravel()
        except (TypeError, ValueError):
            given = np.zeros(0, dtype=complex)
        if not given.size or not np.all(np.isfinite(given) & (given.imag > 0) & (given.real <= 0)):
            rule = "poles are complex, in rad/s: −ζω + jω√(1−ζ²), with ω > 0"
            remedy = "For frequencies write hz=[78.7, 100.3]"
            raise InputError("poles", f"{poles!r:.60}", rule, remedy)
        frequency_hz = np.abs(given) / (2 * np.pi)
        return cls(given, (0.8 * float(frequency_hz.min()), 1.2 * float(frequency_hz.max())))


@dataclass(frozen=True, eq=False)
class _Groups:
    """Rows of a history that belong together, group by group."""

    history: PoleHistory
    members: list[NDArray[np.int_]]

    @cached_property
    def orders(self) -> list[NDArray[np.int_]]:
        """Model orders that contain each group."""
        return [np.unique(self.history.model_order[rows]) for rows in self.members]

    @cached_property
    def sizes(self) -> NDArray[np.int_]:
        """Number of these."""
        return np.array([orders.size for orders in self.orders])

    @cached_property
    def centre(self) -> NDArray[np.complex128]:
        """Median pole of the higher half of the orders, where the noise is modelled best."""
        poles, order = self.history.poles, self.history.model_order
        upper = [poles[rows][order[rows] >= np.median(order[rows])] for rows in self.members]
        return np.array([complex(np.median(each.real), np.median(each.imag)) for each in upper])

    @cached_property
    def near(self) -> NDArray[np.bool_]:
        """Which groups lie within the half-width of each other's resonance, or are the same."""
        width = -self.centre.real
        near = np.abs(self.centre[:, None] - self.centre) < np.minimum.outer(width, width)
        return np.asarray(near | np.eye(width.size, dtype=bool))


def interpret(
    history: PoleHistory,
    max_order: int,
    settings: IdentificationSettings = IDENTIFICATION,
    *,
    late: bool = False,
) -> tuple[NDArray[np.int_], list[Cluster]]:
    """Group the poles of all orders and decide which groups are modes.

    Returns the label of the cluster of each pole, −1 for those that were cleared, and the clusters,
    ascending in frequency.
    Poles that only high orders show may be modes if `late`; on a circle they are mostly second
    members of pairs, which the orders' own FRFs tell better.
    """
    step, poles = history.step_total, history.poles
    label = np.full(poles.size, -1)
    matched = np.isfinite(step)
    tracks = _tracks(history, _cut(step[matched], settings)) if matched.sum() >= 2 else []
    if not tracks:
        return label, []
    members = _joined(tracks, history, settings.cluster_step_max)
    members.sort(key=lambda rows: float(np.median(np.abs(poles[rows]))))
    for number, rows in enumerate(members):
        label[rows] = number
    groups = _Groups(history, members)
    large = _large(groups.sizes)
    whole = _broken_up(groups, large)
    reasons = _reasons(groups.sizes, large, max_order)
    lasting = _lasting(groups, large, max_order) if late else {}
    for number, first in lasting.items():
        for former in _replaced_by(number, groups, large):
            large[former] = False
            reasons[former] = f"dropped: another pole is in its place from model order {first} on"
        large[number] = True
        reasons[number] = f"kept: in every model order from {first} on"
    for number, count in whole.items():
        large[number] = True
        reasons[number] = f"kept: with the pieces beside it in {count} of {max_order - 1} orders"
    columns = (groups.centre.tolist(), groups.sizes.tolist(), large.tolist(), reasons)
    return label, [Cluster(n, *row) for n, row in enumerate(zip(*columns, strict=True))]


def _tracks(history: PoleHistory, cut: float) -> list[NDArray[np.int_]]:
    """Chains of poles that follow each other in steps below the cut, two or more in a row."""
    track = np.full(history.poles.size, -1)
    count = 0
    for row in np.flatnonzero(history.step_total < cut):
        before = history.match[row]
        if track[before] < 0:
            track[before] = count
            count += 1
        track[row] = track[before]
    return [np.flatnonzero(track == number) for number in range(count)]


def _joined(
    tracks: list[NDArray[np.int_]], history: PoleHistory, cut: float
) -> list[NDArray[np.int_]]:
    """Tracks of one and the same pole, interrupted in between, as one.

    Average linkage of the tracks' last poles; tracks that run side by side are different poles.
    """
    last = np.array([rows[-1] for rows in tracks])
    groups = _linked(history.poles[last], history.shapes[last], cut)
    joined: list[NDArray[np.int_]] = []
    for number in dict.fromkeys(groups.tolist()):
        parts = [tracks[k] for k in np.flatnonzero(groups == number)]
        parts.sort(key=len, reverse=True)
        chains: list[NDArray[np.int_]] = []
        for rows in parts:
            for k, chain in enumerate(chains):
                side_by_side = np.intersect1d(history.model_order[chain], history.model_order[rows])
                if side_by_side.size <= 1:
                    chains[k] = np.concatenate([chain, rows])
                    break
            else:
                chains.append(rows)
        joined += chains
    return joined


def _cut(step: NDArray[np.float64], settings: IdentificationSettings) -> float:
    """Distance that still joins poles: the boundary of two groups of steps, on a log scale."""
    logs = np.sort(np.log10(np.clip(step, 1e-12, 1.0)))
    boundary = _two_means(logs, logs[0], logs[-1])
    # … within what can still mean "the same mode".
    return float(np.clip(10**boundary, settings.cluster_step_min, settings.cluster_step_max))


def _linked(
    poles: NDArray[np.complex128], shapes: NDArray[np.complex128], cut: float
) -> NDArray[np.int_]:
    """Average-linkage clusters."""
    if poles.size < 2:
        return np.zeros(poles.size, dtype=int)
    distance = np.maximum(_distance(poles, shapes), 0)  # whatever the rounding
    condensed = scipy.spatial.distance.squareform((distance + distance.T) / 2, checks=False)
    hierarchy = scipy.cluster.hierarchy
    return np.asarray(hierarchy.fcluster(hierarchy.linkage(condensed, "average"), cut, "distance"))


def _large(sizes: NDArray[np.int_]) -> NDArray[np.bool_]:
    """Large clusters among all; empty ones are added so that large ones alone are not split."""
    padded = np.concatenate([sizes, np.zeros(np.sum(sizes > sizes.max() / 5))]).astype(float)
    boundary = _two_means(np.sort(padded), 0.0, float(sizes.max()))
    return np.asarray(sizes > boundary)


def _broken_up(groups: _Groups, large: NDArray[np.bool_]) -> dict[int, int]:
    """Largest pieces of tracks that broke up, with the number of orders that all pieces cover.

    Two poles that lie too close together for their shapes to settle swap and break off: neither
    is large, though the resonance shows in as many orders as any other. A piece counts where no
    large track lies within the half-width of its resonance.
    """
    whole: dict[int, int] = {}
    for number in np.argsort(-groups.sizes):
        beside = groups.near[number]
        if not np.any(large) or np.any(large & beside) or any(beside[k] for k in whole):
            continue
        covered = np.concatenate([groups.orders[k] for k in np.flatnonzero(beside)])
        count = int(np.unique(covered).size)
        if count >= groups.sizes[large].min():
            whole[int(number)] = count
    return whole


def _lasting(groups: _Groups, large: NDArray[np.bool_], max_order: int) -> dict[int, int]:
    """Groups in every order from their first one to the highest, and that first order.

    Weak or narrow modes appear late: an order must be high enough to spare a pole for them. What
    then is there in each of a quarter of all orders did not come by chance. Two of them within one
    half-width are pieces of one resonance.
    """
    first = np.array([orders[0] for orders in groups.orders])
    lasts = (groups.sizes == max_order + 1 - first) & (groups.sizes > _LASTING * (max_order - 1))
    others = groups.near & ~np.eye(first.size, dtype=bool)
    beside = np.any(others & (lasts | large), axis=1)
    return {int(k): int(first[k]) for k in np.flatnonzero(lasts & ~large & ~beside)}


def _replaced_by(number: int, groups: _Groups, large: NDArray[np.bool_]) -> list[int]:
    """Large groups that end where this one begins, each within the resonance of the other."""
    order, centre = groups.history.model_order, groups.centre
    first = groups.orders[number][0]
    return [
        int(other)
        for other in np.flatnonzero(large)
        if np.mean(order[groups.members[other]] < first) > _ENDED
        and abs(centre[other] - centre[number]) < max(-centre[other].real, -centre[number].real)
    ]


def _two_means(values: NDArray[np.float64], low: float, high: float) -> float:
    """Boundary between two groups of sorted numbers (2-means from given centres)."""
    boundary = (low + high) / 2
    for _ in range(50):
        below, above = values[values <= boundary], values[values > boundary]
        if below.size == 0 or above.size == 0:
            break
        moved = (below.mean() + above.mean()) / 2
        if moved == boundary:
            break
        boundary = moved
    return float(boundary)


def _reasons(sizes: NDArray[np.int_], large: NDArray[np.bool_], max_order: int) -> list[str]:
    fewest = sizes[large].min() if np.any(large) else 0
    return [
        f"{'kept' if kept else 'dropped'}: in {size} of {max_order - 1} model orders"
        + ("" if kept else f"; modes are in {fewest} or more")
        for size, kept in zip(sizes, large, strict=True)
    ]
