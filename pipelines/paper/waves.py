"""Figs. 5 to 10: waves of the undamped ring, at rest and rolling, from three frames."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.core.display import signed
from model import WavePair, bifurcation, natural_frequencies_hz, wave_pair
from model.parameters import TABLE_4_RING
from model.ring import WaveFrame
from pipelines.paper.parts import (
    FIGURE_6_ORDERS,
    SPEED_RAD_S,
    WAVE_ORDER,
    Chapter,
    Column,
    NumberTable,
    Statement,
    verdict,
)
from pipelines.plots.chart import Chart
from pipelines.plots.measurement import on_circle
from pipelines.plots.plot import FAINT, FITTED, MEASURED, RING, Curve, Margins, Note, Panel, Plot
from pipelines.plots.ring import waves_over_speed, waves_plot
from pipelines.report.page import Paragraph

#: Figure, speed and reference system of each sequence.
SEQUENCES: tuple[tuple[int, float, WaveFrame], ...] = (
    (5, 0.0, "rotating"),
    (7, SPEED_RAD_S, "rotating"),
    (8, SPEED_RAD_S, "absolute"),
    (10, SPEED_RAD_S, "stationary"),
)
#: What the paper says of the rolling tyre's pattern, by reference system.
SEEN: tuple[tuple[str, str, WaveFrame], ...] = (
    ("Section 5.1, Fig. 7", "seen from the rolling tyre the pattern turns", "rotating"),
    ("Section 5.2, Fig. 8", "seen from space it turns as well", "absolute"),
    ("Section 5.2, Fig. 10", "seen from the stationary frame it does not move", "stationary"),
)
_DRAWN_SPEEDS = np.arange(0.0, 150.1, 1.0)
_SOUGHT_SPEEDS = np.arange(0.0, 800.0, 0.5)
_FIGURE_9_S = 0.03
#: End of the cycle in Fig. 5, s.
CYCLE_S = 0.008
_INSTANTS = 9  # per cycle, both ends included
INTRODUCTION = (
    "Two waves of one order run around the ring in opposite directions. Their superposition "
    "pulses with the mean of the two frequencies while its pattern turns; the tables give how far "
    "it turns in one cycle, seen from each reference system. The figures show the ring at the "
    "beginning and at the end of a cycle, and the radial displacement at nine instants of it."
)


def waves() -> Chapter:
    """Figs. 5 to 10, from the ring of Table 4 alone."""
    standing, rolling = (wave_pair(TABLE_4_RING, WAVE_ORDER, speed) for speed in (0.0, SPEED_RAD_S))
    return Chapter(
        "waves",
        "Free response: Figs. 5 to 10",
        (
            _figure_6(),
            _table_of_minima(),
            Paragraph(INTRODUCTION),
            _table_of_sequences(),
            *(_sequence(*entry) for entry in SEQUENCES),
            _figure_9(rolling),
        ),
        (*_on_bifurcation(), _on_standing(standing), *_on_rotating(rolling)),
    )


def turn_per_cycle_deg(pair: WavePair, frame: WaveFrame) -> float:
    """Angle by which the pattern of a pair turns in one cycle, degrees."""
    return float(np.rad2deg(pair.pattern_speed_rad_s(frame) * cycle_s(pair)))


def cycle_s(pair: WavePair) -> float:
    """Period of the factor that modulates the pattern in time (eqs 20, 22, 27), s."""
    return float(4.0 * np.pi / (pair.regressive_rad_s + pair.progressive_rad_s))


def _figure_6() -> Chart:
    panels = tuple(
        waves_over_speed(bifurcation(TABLE_4_RING, orders, _DRAWN_SPEEDS), title, SPEED_RAD_S)
        for orders, title in zip(FIGURE_6_ORDERS, ("(a)", "(b)"), strict=True)
    )
    return Chart(
        "figure_6",
        Plot(panels, (19, 9), 2, margins=Margins(right=1.4, between_columns=2.6)),
        "Frequencies of orders 1 to 4 over speed; each splits into two branches.",
        "Fig. 6: bifurcation of the inextensional frequencies in the rotating frame. The grey line "
        "is 67.3 rad/s (80 km/h).",
    )


def _minima() -> tuple[NDArray[np.int_], NDArray[np.float64], NDArray[np.float64]]:
    """Orders above one, and speed and frequency of their lowest progressive wave."""
    orders = np.array([order for pair in FIGURE_6_ORDERS for order in pair if order > 1])
    progressive_hz = bifurcation(TABLE_4_RING, orders, _SOUGHT_SPEEDS).progressive_hz
    return orders, _SOUGHT_SPEEDS[progressive_hz.argmin(axis=1)], progressive_hz.min(axis=1)


def _table_of_minima() -> NumberTable:
    orders, speed_rad_s, lowest_hz = _minima()
    at_rest_hz = natural_frequencies_hz(TABLE_4_RING, orders)
    speed_km_h = 3.6 * speed_rad_s * TABLE_4_RING.mean_radius_m
    columns = (
        Column("order n", "order", orders),
        Column("at / (rad/s)", "speed_rad_s", speed_rad_s, show=1),
        Column("at / (km/h)", "speed_km_h", speed_km_h, show=0),
        Column("lowest / Hz", "lowest_hz", lowest_hz, show=2),
        Column("at rest / Hz", "at_rest_hz", at_rest_hz, show=2),
    )
    caption = "Fig. 6: where the frequency of the progressive wave is lowest"
    return NumberTable("figure_6_minima", caption, columns)


def _table_of_sequences() -> NumberTable:
    pairs = [wave_pair(TABLE_4_RING, WAVE_ORDER, speed) for _, speed, _ in SEQUENCES]
    frames = [frame for _, _, frame in SEQUENCES]
    seen = list(zip(pairs, frames, strict=True))
    patterns = [pair.pattern_speed_rad_s(frame) for pair, frame in seen]
    turns = [turn_per_cycle_deg(pair, frame) for pair, frame in seen]
    speeds = np.array([pair.propagation_speeds_rad_s(frame) for pair, frame in seen])
    return NumberTable(
        "waves",
        f"The two waves of order {WAVE_ORDER} and the pattern they form",
        (
            Column("figure", "figure", [str(number) for number, _, _ in SEQUENCES]),
            Column("Ω / (rad/s)", "speed_rad_s", [speed for _, speed, _ in SEQUENCES]),
            Column("frame", "frame", frames),
            Column("c₁ / (rad/s)", "regressive_rad_s", speeds[:, 0], show=2),
            Column("c₂ / (rad/s)", "progressive_rad_s", speeds[:, 1], show=2),
            Column("cycle / ms", "cycle_ms", [1e3 * cycle_s(p) for p in pairs], show=3),
            Column("pattern / (rad/s)", "pattern_rad_s", patterns, show=2),
            Column("turn per cycle / °", "turn_deg", turns, show=2),
        ),
    )


def _sequence(number: int, speed_rad_s: float, frame: WaveFrame) -> Chart:
    pair = wave_pair(TABLE_4_RING, WAVE_ORDER, speed_rad_s)
    angles = np.linspace(0.0, 2.0 * np.pi, 361)
    times = np.linspace(0.0, cycle_s(pair), _INSTANTS)
    turn = turn_per_cycle_deg(pair, frame)
    moves = "does not move" if turn < 0.01 else f"turns by {turn:.1f}° per cycle"
    return Chart(
        f"figure_{number}",
        waves_plot(angles, times, pair.radial(angles, times, frame) / 4.0),
        f"Superposed waves of order {WAVE_ORDER} at {speed_rad_s:g} rad/s, {frame} frame.",
        f"Fig. {number}: superposed waves, n = {WAVE_ORDER}, Ω = {speed_rad_s:g} rad/s, {frame} "
        f"reference system. The pattern {moves}. Left: beginning (solid) and end (dashed) of a "
        "cycle; right: nine instants of it.",
    )


def _figure_9(pair: WavePair) -> Chart:
    """Axes of both frames, and a point of the belt seen from each."""
    turned, point = float(np.rad2deg(pair.beta_rad_s * _FIGURE_9_S)), 55.0
    turn = np.arange(0.0, 361.0, 2.0)
    series: list[Any] = [Curve(*on_circle(turn, size), MEASURED, width=1.7) for size in (0.3, 1.0)]
    spokes = [on_circle(angle, np.array([0.3, 1.0])) for angle in np.arange(0.0, 360.0, 15.0)]
    series += [Curve(*spoke, FAINT, width=1.0) for spoke in spokes]
    for start, colour, dash, names in (
        (0.0, RING, "solid", ("x", "z")),
        (turned, FITTED, "dash", ("x′", "z′")),
    ):
        for angle, name in zip((start, start + 90.0), names, strict=True):
            series.append(Curve(*on_circle(angle, np.array([0.0, 1.3])), colour, "", 1.7, dash))
            series.append(Note(*on_circle(angle, 1.4), name, colour))
    arcs = (0.55, 0.0, point, RING, "θ"), (0.8, turned, point, FITTED, "γ")
    for size, first, last, colour, name in (*arcs, (1.14, 0.0, turned, MEASURED, "βt")):
        series.append(Curve(*on_circle(np.linspace(first, last, 60), size), colour, "", 1.7))
        series.append(Note(*on_circle(0.6 * first + 0.4 * last, size + 0.1), name, colour))
    series.append(Curve(*on_circle(point, np.array([1.0])), MEASURED, "", marker="circle"))
    return Chart(
        "figure_9",
        Plot((Panel(tuple(series), equal=True, bare=True),), (10, 10)),
        "The ring with the axes of the rotating and of the stationary frame.",
        "Fig. 9: rotating frame (x, z) and stationary frame (x′, z′), θ = γ + βt (eq 29), drawn "
        f"{1e3 * _FIGURE_9_S:.0f} ms after both coincided, for n = {WAVE_ORDER} at {SPEED_RAD_S:g} "
        f"rad/s: with β = {signed(pair.beta_rad_s, 2)} rad/s the frame turns against the tyre.",
    )


def _on_bifurcation() -> tuple[Statement, ...]:
    found = bifurcation(TABLE_4_RING, [1, *_minima()[0]], _DRAWN_SPEEDS)
    rest_hz, shift_hz = found.regressive_hz[0, 0], _DRAWN_SPEEDS / (2.0 * np.pi)
    bend = max(
        float(np.abs(found.regressive_hz[0] - rest_hz - shift_hz).max()),
        float(np.abs(found.progressive_hz[0] - rest_hz + shift_hz).max()),
    )
    rising = bool(np.all(np.diff(found.regressive_hz, axis=1) > 0))
    orders, speeds, _ = _minima()
    inside = bool(np.all((speeds > 0) & (speeds < _SOUGHT_SPEEDS[-1])))
    listed = ", ".join(f"{s:.0f} (n = {n})" for n, s in zip(orders, speeds, strict=True))
    return (
        Statement(
            "Section 5.1, Fig. 6",
            "the bifurcation of n = 1 is linear",
            f"Up to 150 rad/s it stays within {bend:.4f} Hz of f ± Ω/2π.",
            verdict(bend < 0.01),
        ),
        Statement(
            "Section 5.1, Fig. 6",
            "the frequencies of the regressive waves always grow with the speed",
            "So they do for n = 1 to 4 up to 150 rad/s."
            if rising
            else "They do not everywhere up to 150 rad/s.",
            verdict(rising),
        ),
        Statement(
            "Section 5.1, Fig. 6",
            "for n > 1 those of the progressive waves have a minimum",
            f"The minima lie at {listed} rad/s; that of n = 2 is beyond any road speed.",
            verdict(inside),
        ),
    )


def _on_standing(pair: WavePair) -> Statement:
    cycle = cycle_s(pair)
    still = turn_per_cycle_deg(pair, "rotating") < 0.01
    return Statement(
        "Section 5.1, Fig. 5",
        "at rest the two waves form a standing wave; a cycle of n = 3 ends at 0.008 s",
        f"The pattern does not move; a cycle of order 3 takes {1e3 * cycle:.2f} ms.",
        verdict(still and round(cycle, 3) == CYCLE_S),
    )


def _on_rotating(pair: WavePair) -> tuple[Statement, ...]:
    apart = abs(pair.progressive_ratio / pair.regressive_ratio - 1.0)
    similar = Statement(
        "Section 5.1",
        "B of the regressive and of the progressive wave are very similar",
        f"B is {pair.regressive_ratio:.4f} and {pair.progressive_ratio:.4f} for n = 3 at 67.3 "
        f"rad/s: {100.0 * apart:.2g} % apart.",
        verdict(apart < 0.05),
    )
    turning = []
    for place, printed, frame in SEEN:
        turn, beta = turn_per_cycle_deg(pair, frame), signed(pair.beta_rad_s, 2)
        if frame == "stationary":
            found, holds = f"{turn:.1g}°, with β = {beta} rad/s", turn < 0.01
        else:
            found, holds = f"{turn:.1f}°", turn > 1.0
        found = f"Per cycle it turns by {found} in the {frame} frame."
        turning.append(Statement(place, printed, found, verdict(holds)))
    return (similar, *turning)
