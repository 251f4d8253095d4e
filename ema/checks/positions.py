"""Position check: whether the sensors sat where the manifest says.

At the right angles the shape of a ring mode is a wave cos n(θ − θ_n). Where the stated angles give
something else, the usual mistakes are tried: the tyre turned the other way between the runs,
sensors counted the other way, one run at other angles.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ema.checks.ring_shapes import close_modes
from ema.circumference.orders import highest_order, on_circle, order_basis
from ema.core.finding import Check, Finding, Verdict
from ema.core.frf import FRF
from ema.core.settings import CHECKS, CheckSettings
from ema.fitting.fit_steps import modes_of
from ema.fitting.pole_fit import N_DRIFT, N_STAND_INS, evaluate, lines_to_fit, starting_poles
from ema.poles.tracking import PoleSelection

# Angles that are tried for a run.
_STEP_DEG = 0.5
# Sensors are placed to about half a degree; a smaller offset is no mistake of the manifest.
_LEAST_OFFSET_DEG = 1.0
# Orders that are tried even where so few sensors do not tell them from lower ones, and the share
# of a cosine below which its sine is nothing (order 6 on twelve sensors).
_HIGHEST, _RANK = 15, 1e-6
# A run with fewer sensors fits at too many angles.
_FEWEST_SENSORS = 3
# Rows beyond this share may have faults of their own …
_JUDGED = 0.9
# … and none has more say than a pure wave could have: it does not exceed its median as far.
_LIMIT = 2.0
# At the right angles no more than this many times `position_share` is left: a run with a force of
# wrong sign looks like a turned one, but for 7 %.
_MOST_LEFT = 4.0
# Of hypotheses that explain nearly as much the first one, the more common mistake, is named.
_AS_GOOD = 1.5
# Modes with less of the strongest one's response do not count. One mode looks the same after some
# turn whatever is wrong; this many do not.
_STRONG, _FEWEST_MODES = 0.03, 3
# Axes of the sensors: tyres with 2 to 5 % of damping leave 0.84 of the power in one pattern where
# the axes are right, 0.57 where they are not. Twelve positions, which tell five orders, take
# higher ones for these.
_CLEARLY, _FEWEST_ORDERS = 0.05, 8

_Move = tuple[int, float]


@dataclass(frozen=True)
class PositionCheck:
    """What the shapes of the modes say about the angles of the sensors."""

    unexplained: float  # share of the modes' response in no wave of one order at the stated angles
    # Mistake that would explain the shapes; empty: none does or none is needed.
    hypothesis: str = ""
    otherwise: float = float("nan")  # the same share under the hypothesis
    # By run: sign and offset, the angle would be sign·θ + offset.
    moves: dict[str, _Move] = field(default_factory=dict)
    orders_hold: bool = True  # whether the orders are those at the stated angles all the same


def check_positions(
    frf: FRF, poles: PoleSelection, band_hz: tuple[float, float], settings: CheckSettings = CHECKS
) -> PositionCheck:
    """Look for a mistake in the angles that explains why shapes are no waves.

    Parameters
    ----------
    frf : FRF
        Of a closed circle of positions.
    poles : PoleSelection
        From `select_poles`; what they are does not depend on the angles.
    band_hz : tuple of float
    settings : CheckSettings

    Returns
    -------
    PositionCheck
        With a hypothesis only if it explains what the stated angles leave over but for a small
        rest.
    """
    shapes = _shapes(frf, poles, band_hz)
    left, orders = _unexplained(shapes, frf.position_deg)
    power = np.sum(np.abs(shapes) ** 2, axis=1)
    strong = power > _STRONG * power.max()
    if left < settings.position_share or np.count_nonzero(strong) < _FEWEST_MODES:
        return PositionCheck(left)
    tried = [
        (*_unexplained(shapes, moved(frf, moves)), says, moves)
        for says, moves in _hypotheses(frf, shapes)
    ]
    best = min((each[0] for each in tried), default=np.inf)
    if best > min(left / settings.position_factor, _MOST_LEFT * settings.position_share):
        return PositionCheck(left)
    rest, others, says, moves = next(each for each in tried if each[0] <= _AS_GOOD * best)
    hold = bool(np.all(orders[strong] == others[strong]))
    return PositionCheck(left, says, rest, moves, hold)


def unexplained_share(frf: FRF, poles: PoleSelection, band_hz: tuple[float, float]) -> float:
    """Share of the response of the modes that is in no wave of one order."""
    return _unexplained(_shapes(frf, poles, band_hz), frf.position_deg)[0]


def no_wave_finding(share: float, settings: CheckSettings = CHECKS) -> list[Finding]:
    """Doubt all orders where much of the response is in no wave; nothing otherwise."""
    if share <= settings.no_wave_share:
        return []
    detail = (
        f"{100 * share:.2g} % of the response of the modes is in no wave of one order, and no "
        "common mistake in the angles explains it: orders are not certain. Check positions_deg of "
        "all runs; a structure that is not the same all around has no orders"
    )
    return [Finding("", "", None, Check.POSITIONS, Verdict.WARNING, detail)]


def moved(frf: FRF, moves: dict[str, _Move]) -> NDArray[np.float64]:
    """Angles of the rows under a hypothesis."""
    sign, offset = np.array([moves.get(run, (1, 0.0)) for run in frf.run]).T
    return np.asarray(np.mod(sign * frf.position_deg + offset, 360.0))


def position_findings(check: PositionCheck, frf: FRF) -> list[Finding]:
    """The hypothesis with its evidence, and the line of the manifest for each run it concerns.

    Parameters
    ----------
    check : PositionCheck
    frf : FRF
        All rows as measured.
    """
    if not check.hypothesis:
        return []
    share, rest = (f"{100 * part:.2g} %" for part in (check.unexplained, check.otherwise))
    taken = "No sensor was corrected"
    if not check.orders_hold:
        taken = "Modes are fitted as if so, their orders left open and masses not compensated"
    detail = (
        f"{share} of the response of the modes is in no wave of one order at the stated angles, "
        f"{rest} if {check.hypothesis}. {taken}; check the set-up and correct positions_deg"
    )
    findings = [Finding("", "", None, Check.POSITIONS, Verdict.WARNING, detail)]
    for run in check.moves:
        line = f"if so, in [[runs]] of this file: positions_deg = {{ {_line(frf, check, run)} }}"
        findings.append(Finding(run, "", None, Check.POSITIONS, Verdict.WARNING, line))
    return findings


def _line(frf: FRF, check: PositionCheck, run: str) -> str:
    """Channels and angles of a run as the manifest has them, the fixed sensor included."""
    angles = moved(frf, check.moves)
    rows = [row for row in range(frf.n_positions) if frf.run[row] == run]
    pairs = [(frf.channel[row], float(angles[row])) for row in rows]
    if frf.reference is not None and run in frf.reference.run:
        at = frf.reference.run.index(run)
        pairs.append((frf.reference.channel[at], float(frf.reference.position_deg[at])))
    return ", ".join(f"{_key(name)} = {angle:g}" for name, angle in pairs if np.isfinite(angle))


def _key(name: str) -> str:
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else json.dumps(name, ensure_ascii=False)


def _shapes(frf: FRF, poles: PoleSelection, band_hz: tuple[float, float]) -> NDArray[np.complex128]:
    """Residues times |s|, (n_modes, n_positions), nothing assumed about orders; outliers tamed."""
    lines = lines_to_fit(frf, band_hz)
    fit = evaluate(lines, starting_poles(poles.poles, lines, band_hz), np.zeros((1, N_DRIFT)))
    groups = close_modes(modes_of(fit)[:-N_STAND_INS])
    shapes = np.array([sum(mode.residues * abs(mode.pole) for mode in each) for each in groups])
    size = np.maximum(np.abs(shapes), np.finfo(float).tiny)
    return np.asarray(shapes * np.minimum(1, _LIMIT * np.median(size, axis=1)[:, None] / size))


def _unexplained(
    shapes: NDArray[np.complex128], position_deg: NDArray[np.float64]
) -> tuple[float, NDArray[np.int_]]:
    """Share of the power in no wave of one order, and the order of each shape."""
    left = []
    for order in range(max(highest_order(position_deg), _HIGHEST) + 1):
        basis = order_basis(position_deg, order)
        wave = basis @ np.linalg.pinv(basis, rcond=_RANK)
        left.append(np.abs(shapes - shapes @ wave) ** 2)
    orders = np.argmin(np.sum(left, axis=2), axis=0)
    of_row = np.sum(np.array(left)[orders, np.arange(orders.size)], axis=0)
    judged = np.sort(of_row)[: int(np.ceil(_JUDGED * of_row.size))]
    return float(judged.sum() / np.sum(np.abs(shapes) ** 2)), orders


def _hypotheses(frf: FRF, shapes: NDArray[np.complex128]) -> Iterator[tuple[str, dict[str, _Move]]]:
    """Mistakes that happen, the more common ones first."""
    turns = _turns(frf)
    if turns:
        yield (
            "the tyre was turned the other way between the runs (sensors counted the other way "
            "round all the time look the same)",
            {run: (1, -2 * turn) for run, turn in turns.items()},
        )
    found = [(run, _best_moves(frf, shapes, run)) for run in frf.run_names]
    for sign in (1, -1):
        for run, moves in found:
            if sign not in moves or (sign == 1 and _away(moves[1]) < _LEAST_OFFSET_DEG):
                continue
            counted = "counted the other way and " if sign < 0 else ""
            turn = (moves[sign] + 180) % 360 - 180
            where = f"turned by {turn:+g}°" if sign > 0 else f"turned to {moves[sign]:g}° − angle"
            yield f"the sensors of {run} were {counted}{where}", {run: (sign, moves[sign])}


def _away(angle_deg: float) -> float:
    return abs((angle_deg + 180) % 360 - 180)


def _turns(frf: FRF) -> dict[str, float]:
    """Angle by which each run but the first one is turned; empty where they are not turned."""
    first = frf.run_names[0]
    home = {
        frf.channel[row]: frf.position_deg[row]
        for row in range(frf.n_positions)
        if frf.run[row] == first
    }
    turns: dict[str, float] = {}
    for run in frf.run_names[1:]:
        by = [
            (frf.position_deg[row] - home[frf.channel[row]]) % 360
            for row in range(frf.n_positions)
            if frf.run[row] == run and frf.channel[row] in home
        ]
        if not by or max(_away(angle - by[0]) for angle in by) > _LEAST_OFFSET_DEG:
            return {}
        turns[run] = float(by[0])
    return turns


def _best_moves(frf: FRF, shapes: NDArray[np.complex128], run: str) -> dict[int, float]:
    """Offsets at which the sensors of a run fit the waves of all others, by counting direction."""
    own = np.array([name == run for name in frf.run])
    angles = frf.position_deg
    if np.sum(own) < _FEWEST_SENSORS or not on_circle(angles[~own]):
        return {}
    _, orders = _unexplained(shapes[:, ~own], angles[~own])
    offsets = np.arange(0.0, 360.0, _STEP_DEG)
    moves = {}
    for sign in (1, -1):
        tried = np.add.outer(offsets, sign * angles[own])
        left = np.zeros(offsets.size)
        for shape, order in zip(shapes, orders, strict=True):
            amplitude = np.linalg.lstsq(order_basis(angles[~own], order), shape[~own])[0]
            there = order_basis(tried.ravel(), order) @ amplitude
            left += np.sum(np.abs(shape[own] - there.reshape(tried.shape)) ** 2, axis=1)
        moves[sign] = float(offsets[np.argmin(left)])
    return moves


def axes_finding(frf: FRF, band_hz: tuple[float, float]) -> list[Finding]:
    """Whether the sensors point outwards, or all of them along one axis of space.

    Near a resonance, radial motion is mostly one order. Along an axis of space it is not: with a
    belt that does not stretch (u_r = −∂u_t/∂θ), order n shows as orders n − 1 and n + 1. The share
    of the power in the strongest pattern of each line is compared between both, for axes towards
    0° and 90°.

    Parameters
    ----------
    frf : FRF
    band_hz : tuple of float

    Returns
    -------
    list of Finding
        A warning about an axis of space; what was taken as radial where the files state axes;
        nothing without a circle.
    """
    lines = (frf.frequency_hz >= band_hz[0]) & (frf.frequency_hz <= band_hz[1])
    if not on_circle(frf.position_deg):
        return []
    highest = highest_order(frf.position_deg)
    values = frf.values[:, lines]
    known = np.isfinite(values).all(axis=1) & (np.abs(values) > 0).any(axis=1)
    if highest < _FEWEST_ORDERS or known.sum() < 2 * highest:
        return _taken_as_radial(frf, "too few positions for the FRFs to tell")
    values, angle = values[known], frf.position_deg[known]
    radial = _largest_share(values, [order_basis(angle, n) for n in range(highest + 1)])
    towards = {
        axis_deg: _largest_share(
            values, [_along_axis(angle, n, axis_deg) for n in range(1, highest + 1)]
        )
        for axis_deg in (0, 90)
    }
    axis_deg = max(towards, key=towards.__getitem__)
    share = towards[axis_deg]
    shares = (
        f"{radial:.2f} of the power in one pattern if radial, {share:.2f} if all along one axis"
    )
    if share > radial + _CLEARLY:
        detail = (
            f"the sensors seem to point along one axis of space, that at {axis_deg}°, not outwards "
            f'({shares}). State axes = ["X", "Z"] in [grid], those at 0° and 90°, and measure both'
        )
        return [Finding("", "", None, Check.DIRECTION, Verdict.WARNING, detail)]
    told = "the FRFs agree" if radial > share + _CLEARLY else "the FRFs do not tell"
    return _taken_as_radial(frf, f"{told} ({shares})")


def _taken_as_radial(frf: FRF, why: str) -> list[Finding]:
    """What was taken as radial; nothing where files state no axes."""
    letters = ", ".join("XYZ"[axis - 1] for axis in np.unique(frf.axis[frf.axis > 0]))
    detail = f"{letters} of each node taken as radial: {why}"
    return [Finding("", "", None, Check.DIRECTION, Verdict.OK, detail)] if letters else []


def _largest_share(
    values: NDArray[np.complex128], patterns: Sequence[NDArray[np.float64]]
) -> float:
    """Power over all lines that the strongest pattern of each line carries, as a share."""
    power = [
        np.sum(np.abs(np.linalg.qr(pattern)[0].T @ values) ** 2, axis=0) for pattern in patterns
    ]
    return float(np.max(power, axis=0).sum() / np.sum(np.abs(values) ** 2))


def _along_axis(
    position_deg: NDArray[np.float64], order: int, axis_deg: float
) -> NDArray[np.float64]:
    """Both waves of an order, seen along the axis of space at an angle."""
    angle = np.deg2rad(position_deg)
    off = (angle - np.deg2rad(axis_deg))[:, None]
    radial = np.column_stack([np.cos(order * angle), np.sin(order * angle)])
    tangential = np.column_stack([-radial[:, 1], radial[:, 0]]) / order
    return np.asarray(radial * np.cos(off) - tangential * np.sin(off))
