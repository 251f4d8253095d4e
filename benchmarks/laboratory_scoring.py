"""Identified modes of a laboratory campaign against its exact modes."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from ema.core.modes import Mode
from pipelines.simulate.laboratory import LaboratoryMode

# A member of a pair is driven if it has at least this share of its order's strength …
DRIVEN_SHARE = 0.1
# … an order with less than this share of the strongest mode's is not driven at all …
UNDRIVEN = 1e-3
# … a pair split by less than this many half-widths (damping ratio × frequency) may be one mode,
# the mean weighted by strength …
MERGED_SPLIT = 0.5
# … and two driven members must be told apart from this many on. In between, one mode has no
# damping to be compared with.
RESOLVABLE_SPLIT = 1.0
# A row belongs to an order up to this share of its frequency …
REACH = 0.01
# … and to a mode of rim, sidewall or air, or to one cut by the band's end, up to this share or what
# its 95 % interval says, but no further than to an order.
OTHER_REACH = 0.005
# A row that says the order is no other mode within this many of its standard deviations.
SAID = 3.0


@dataclass(frozen=True)
class Row:
    """A mode as a method lists it; NaN and None where the method does not tell."""

    frequency_hz: float
    damping_ratio: float
    frequency_std_hz: float = float("nan")
    damping_std: float = float("nan")
    order: int | None = None
    doubtful: bool = False

    @classmethod
    def of(cls, mode: Mode) -> Row:
        """A mode as ringmodal lists it."""
        return cls(
            mode.frequency_hz,
            mode.damping_ratio,
            mode.frequency_std_hz,
            mode.damping_std,
            mode.order,
            mode.doubtful,
        )


@dataclass(frozen=True)
class Target:
    """What a row is compared with; NaN damping is not compared."""

    name: str
    order: int | None
    frequency_hz: float
    damping_ratio: float


@dataclass(frozen=True)
class Match:
    """A row and its target."""

    target: Target
    row: Row
    is_main: bool = False  # the strongest mode of its order

    @property
    def errors_percent(self) -> tuple[float, float]:
        """Relative errors of frequency and damping."""
        return (
            100 * (self.row.frequency_hz / self.target.frequency_hz - 1),
            100 * (self.row.damping_ratio / self.target.damping_ratio - 1),
        )

    @property
    def z(self) -> tuple[float, float]:
        """Errors of frequency and damping over their standard deviations."""
        return (
            (self.row.frequency_hz - self.target.frequency_hz) / self.row.frequency_std_hz,
            (self.row.damping_ratio - self.target.damping_ratio) / self.row.damping_std,
        )

    @property
    def is_mislabelled(self) -> bool:
        """Whether the row has another order than the mode."""
        return None not in (self.row.order, self.target.order) and (
            self.row.order != self.target.order
        )


@dataclass(frozen=True)
class Score:
    """One method on one campaign."""

    matches: list[Match] = field(default_factory=list)
    missed: list[Target] = field(default_factory=list)
    invented: list[Row] = field(default_factory=list)


@dataclass(frozen=True)
class Order:
    """The one or two ring modes of an order."""

    members: tuple[LaboratoryMode, ...]

    @property
    def merged(self) -> Target:
        """Mean of the members weighted by strength; no damping where they are too far apart."""
        weight = np.array([mode.strength for mode in self.members])
        pole = complex(weight @ [mode.pole for mode in self.members] / weight.sum())
        found = _target(self.members[0].order, "", pole)
        if self.is_one or self.split < MERGED_SPLIT:
            return found
        return Target(found.name, found.order, found.frequency_hz, float("nan"))

    @property
    def each(self) -> list[Target]:
        """Members one by one."""
        return [
            _target(m.order, member, m.pole) for m, member in zip(self.members, "ab", strict=False)
        ]

    @property
    def split(self) -> float:
        """Distance of the members in half-widths."""
        hz = [mode.frequency_hz for mode in self.members]
        return (max(hz) - min(hz)) / (self.members[0].damping_ratio * min(hz))

    @property
    def is_one(self) -> bool:
        """Whether only one member is there or driven."""
        strength = np.array([mode.strength for mode in self.members])
        return strength.min() < DRIVEN_SHARE * strength.sum() or strength.size == 1

    @property
    def main(self) -> Target:
        """The one mode that a method with one mode per order finds."""
        if not self.is_one and self.split < RESOLVABLE_SPLIT:
            return self.merged
        return self.strongest

    @property
    def strongest(self) -> Target:
        """The member that is driven most."""
        return self.each[int(np.argmax([mode.strength for mode in self.members]))]

    @property
    def needed(self) -> list[Target]:
        """What has to be found."""
        far = not self.is_one and self.split >= RESOLVABLE_SPLIT
        return self.each if far else [self.main]


def orders_of(modes: tuple[LaboratoryMode, ...], band_hz: tuple[float, float]) -> list[Order]:
    """Orders n ≥ 1 of the ring whose modes are all in the band."""
    ring = [mode for mode in modes if mode.kind == "ring" and mode.order > 0]
    found = [
        Order(tuple(mode for mode in ring if mode.order == order))
        for order in sorted({mode.order for mode in ring})
    ]
    low, high = band_hz
    least = UNDRIVEN * max((mode.strength for mode in ring), default=0.0)
    return [
        one
        for one in found
        if all(low < m.frequency_hz < high for m in one.members)
        and max(m.strength for m in one.members) > least
    ]


def score(
    modes: tuple[LaboratoryMode, ...], rows: list[Row], band_hz: tuple[float, float]
) -> Score:
    """Compare rows with the truth; modes of rim, sidewall and air need not be found."""
    matches: list[Match] = []
    missed: list[Target] = []
    left = [row for row in rows if band_hz[0] < row.frequency_hz < band_hz[1]]
    orders = orders_of(modes, band_hz)
    centres = np.array([one.main.frequency_hz for one in orders])
    foreign = [m for m in modes if m.kind != "ring" or m.order == 0]
    others = [_target(None, "", m.pole, m.kind) for m in foreign]
    for place, one in enumerate(orders):
        inside = [row for row in left if _place(row, orders, centres) == place]
        inside = [row for row in inside if _is_near(row, one)]
        inside = [row for row in inside if not _is_other(row, one, foreign)]
        if not one.is_one and len(inside) == 1 and one.split >= RESOLVABLE_SPLIT:
            wanted = one.each
        else:
            wanted = [one.main] if len(inside) < 2 else one.each
        found = _assigned(wanted, inside)
        matches += [replace(m, is_main=m.target in (one.main, one.strongest)) for m in found]
        names = {match.target.name for match in found}
        missed += [t for t in one.needed if not found or (t in wanted and t.name not in names)]
        left = [row for row in left if row not in [match.row for match in found]]
    edge = [m for m in modes if m.kind == "ring"]  # orders cut by the end of the band
    outside = [_target(m.order, "", m.pole) for m in edge if m.order not in _numbers(orders)]
    for row in list(left):
        nearest = min([*others, *outside], key=lambda t: abs(t.frequency_hz - row.frequency_hz))
        free = nearest not in [match.target for match in matches]
        if free and abs(row.frequency_hz / nearest.frequency_hz - 1) < _reach(row):
            matches.append(Match(nearest, row))
            left.remove(row)
    return Score(matches, missed, left)


def _numbers(orders: list[Order]) -> set[int]:
    return {one.members[0].order for one in orders}


def _place(row: Row, orders: list[Order], centres: np.ndarray) -> int:
    """The order that a row says, where it is near; otherwise the nearest one."""
    for place, one in enumerate(orders):
        if one.members[0].order == row.order and _is_near(row, one):
            return place
    return int(np.argmin(np.abs(centres - row.frequency_hz)))


def _is_near(row: Row, one: Order) -> bool:
    return any(abs(row.frequency_hz / m.frequency_hz - 1) < REACH for m in one.members)


def _is_other(row: Row, one: Order, foreign: list[LaboratoryMode]) -> bool:
    """Whether another mode of the tyre is much nearer than the order, or near and of its order."""
    own = min(abs(row.frequency_hz - m.frequency_hz) for m in one.members)
    says_so = row.order == one.members[0].order
    if says_so and own < SAID * row.frequency_std_hz:
        return False
    if not says_so:
        of_row = [m.frequency_hz for m in foreign if m.order == row.order]
        if any(abs(row.frequency_hz / hz - 1) < _reach(row) for hz in of_row):
            return True
    return any(abs(row.frequency_hz - m.frequency_hz) < 0.2 * own for m in foreign)


def _reach(row: Row) -> float:
    """How far, as a share, a row of rim, sidewall or air may be off: as its own ± say."""
    within = np.nan_to_num(1.96 * row.frequency_std_hz / row.frequency_hz)
    return float(np.clip(within, OTHER_REACH, REACH))


def _assigned(targets: list[Target], rows: list[Row]) -> list[Match]:
    """Each target with one row, closest together in all."""
    if not rows:
        return []
    wanted = np.array([target.frequency_hz for target in targets])
    distance = np.abs(wanted[:, None] - [row.frequency_hz for row in rows])
    chosen = zip(*linear_sum_assignment(distance), strict=True)
    return [Match(targets[t], rows[r]) for t, r in chosen]


def _target(order: int | None, member: str, pole: complex, kind: str = "order") -> Target:
    size = abs(pole)
    name = kind if order is None else f"{kind} {order}{member}"
    return Target(name, order, size / (2 * np.pi), -pole.real / size)
