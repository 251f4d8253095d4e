"""The section on FRFs: measured, fitted and of the ring, at any position, and FRAC.

In the page measured FRFs are 16-bit numbers. Fitted ones and those of the ring follow there from
poles, residues and the ring's matrices, which are far smaller than the curves.
"""

from __future__ import annotations

from base64 import b64encode
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ema.core.frf import FRF
from ema.core.modes import ModalModel
from model.forced import ForcedRing, inertance
from pipelines.plots.chart import Chart, packed
from pipelines.plots.modes import (
    fitted_curves,
    frac_chart,
    frf_plot,
    nyquist_chart,
    overlay_chart,
    position_names,
    shown_band_hz,
    sum_chart,
)
from pipelines.report.identification import NO_MODE
from pipelines.report.page import Beside, Block, Chooser, Paragraph, Section
from pipelines.results.result import Result
from pipelines.results.tables import in_band, place_name, short

SHOWN_ANGLE_DEG = 100.0  # the angle from the force that the literature on this test shows
MOST_POSITIONS = 600
MOST_VALUES = 450_000  # of all positions: some 2.4 MB in the page
STEPS_PER_UNIT = 100  # 0.01 dB and 0.01°
EVEN_SHARE = 0.5  # share of thinned lines that is spread evenly; the others crowd around the modes


def responses(result: Result) -> Section:
    """FRFs of any position, measured, fitted and of the ring, and how alike they are."""
    title = "Measured and fitted FRFs"
    if not result.modal_model.modes:
        return Section("frf", title, (Paragraph(NO_MODE),))
    blocks: list[Block] = [_chooser(result)]
    if (why := _why_no_ring(result)) is not None:
        blocks.append(Paragraph(why))
    frf, model = result.frf, result.modal_model
    blocks.append(Beside((sum_chart(frf, model), nyquist_chart(frf, model, _first_shown(result)))))
    if frf.n_positions > 1:
        blocks += [frac_chart(model), overlay_chart(frf, model)]
    return Section("frf", title, tuple(blocks))


def shown_rows(result: Result) -> tuple[int, ...]:
    """Rows of the FRFs worth showing: at the force, at 100° from it, and the worst fitted.

    Without a circle of sensors the first row replaces the first two.
    """
    angles = result.frf.position_deg
    rows = [0]
    if np.isfinite(angles).all():
        start = result.excitation_deg or 0.0
        wanted = start + np.array([[0.0], [SHOWN_ANGLE_DEG]])
        rows = np.argmin(np.abs((angles - wanted + 180) % 360 - 180), axis=1).tolist()
    return tuple(dict.fromkeys([*rows, int(np.argmin(result.modal_model.frac))]))


def _first_shown(result: Result) -> int:
    """Row whose FRF the page shows first."""
    return shown_rows(result)[:2][-1]


def _chooser(result: Result) -> Chooser:
    frf, model = result.frf, result.modal_model
    shown = shown_rows(result)
    rows = kept_positions(frf.n_positions, shown)
    band = np.flatnonzero(in_band(frf.frequency_hz, shown_band_hz(model)))
    poles = np.array([mode.pole for mode in model.modes])
    lines = band[kept_lines(frf.frequency_hz[band], poles, MOST_VALUES // rows.size)]
    ring = ring_data(result, rows)
    names = position_names(frf)
    named = ((names[row], short(frf.run[row]), short(frf.channel[row])) for row in rows)
    options = tuple(
        " · ".join([*filter(None, parts), f"FRAC {model.frac[row]:.4f}"])
        for row, parts in zip(rows, named, strict=True)
    )
    content = {
        "rows": rows.tolist(),
        "frequency_hz": packed(frf.frequency_hz[lines]),
        "measured": measured_data(frf.values[np.ix_(rows, lines)]),
        "fitted": fitted_data(frf, model, rows),
        "ring": ring,
        "nyquist_hz": list(model.band_hz),
    }
    empty = np.empty(0), np.empty(0, dtype=complex)
    curves = dict.fromkeys(("fitted", "measured", *(["ring"] if ring else [])), empty)
    chart = Chart(
        "frf",
        frf_plot(frf, model, curves),
        "Magnitude and phase of the inertance, measured and fitted.",
        f"Inertance of the position chosen. {_what_to_look_for(result)}"
        f"{_left_out(lines.size, band.size, rows.size, frf.n_positions)}",
        wide=True,
        height_px=470,
    )
    first = int(np.searchsorted(rows, _first_shown(result)))

    def printed() -> tuple[Chart, ...]:
        return tuple(_printed(result, row) for row in shown)

    return Chooser(chart, "Position", options, first, content, printed)


def _what_to_look_for(result: Result) -> str:
    model = result.modal_model
    known = _forced(result) is not None
    ring = " Dashed: the tuned ring, radial force and response." if known else ""
    outside = shown_band_hz(model) != model.band_hz
    shaded = " Shaded: fitted, but outside the band of interest." if outside else ""
    return (
        "The fitted curve should pass through the measured one at peaks and between them; a shift "
        f"between peaks points to a missing mode.{shaded}{ring}"
    )


def _printed(result: Result, row: int) -> Chart:
    frf, model = result.frf, result.modal_model
    name, curves = position_names(frf)[row], fitted_curves(frf, model, row)
    if (forced := _forced(result)) is not None:
        lines_hz, angle_rad = curves["measured"][0], float(_from_force_rad(result)[row])
        curves["ring"] = (lines_hz, np.ravel(inertance(forced, lines_hz, angle_rad)))
    title = place_name(int(frf.node[row]), float(frf.position_deg[row]))
    return Chart(
        f"frf-{row + 1}",
        frf_plot(frf, model, curves, title),
        f"Magnitude and phase of the inertance at {name}, measured and fitted.",
        f"Inertance at {name}, FRAC {model.frac[row]:.4f}. {_what_to_look_for(result)}",
    )


def _forced(result: Result) -> ForcedRing | None:
    """The tuned ring with its damping; None where its absolute inertance is not known."""
    tuning, damping = result.tuning, result.damping
    if tuning is None or damping is None or tuning.ring.belt_width_m is None:
        return None
    return ForcedRing(tuning.ring, damping.damping)


def _left_out(n_lines: int, all_lines: int, n_positions: int, all_positions: int) -> str:
    """What does not fit in the page; the files of the result have everything."""
    parts = []
    if n_positions < all_positions:
        parts.append(f"{n_positions} of {all_positions} positions")
    if n_lines < all_lines:
        parts.append(f"{n_lines} of {all_lines} lines, closest around the modes")
    return f" The page has {' and '.join(parts)}; frf.parquet has all." if parts else ""


def _why_no_ring(result: Result) -> str | None:
    """Why the ring has no curve, where there is a ring."""
    if result.tuning is None or _forced(result) is not None:
        return None
    text = "The ring has no curve: absolute amplitudes need the belt's width."
    return f"{text} Add belt_width_m to [tyre] in the manifest."


def kept_positions(n_positions: int, wanted: tuple[int, ...]) -> NDArray[np.int_]:
    """Rows whose FRFs go into the page: all, or evenly chosen ones and those that are wanted."""
    if n_positions <= MOST_POSITIONS:
        return np.arange(n_positions)
    even = np.linspace(0, n_positions - 1, MOST_POSITIONS - len(wanted)).astype(int)
    return np.unique([*even, *wanted])


def kept_lines(
    frequency_hz: NDArray[np.float64], poles: NDArray[np.complex128], at_most: int
) -> NDArray[np.int_]:
    """Indices of the lines to draw: all where there is room, else closer at the resonances.

    Frequencies ascend, shape (n_lines,); poles in rad/s. At most `at_most` indices, ascending.
    """
    if frequency_hz.size <= at_most:
        return np.arange(frequency_hz.size)
    centre_hz = poles.imag[:, None] / (2 * np.pi)
    width_hz = -poles.real[:, None] / np.pi
    near = np.sum(width_hz / ((frequency_hz - centre_hz) ** 2 + width_hz**2), axis=0)
    density = EVEN_SHARE / frequency_hz.size + (1 - EVEN_SHARE) * near / near.sum()
    reached = np.cumsum(density)
    steps = np.linspace(reached[0], reached[-1], at_most)
    return np.unique(np.minimum(np.searchsorted(reached, steps), frequency_hz.size - 1))


def measured_data(values: NDArray[np.complex128]) -> dict[str, str]:
    """Magnitude in dB and phase in degrees, in hundredths, 16 bit each, base64.

    Zero or not finite values are given by the lowest number, and not drawn.
    """
    known = np.isfinite(values) & (values != 0)
    safe = np.where(known, values, 1.0)
    level_db = np.where(known, 20 * np.log10(np.abs(safe)), -np.inf)
    return {"level_db": _hundredths(level_db), "phase_deg": _hundredths(np.angle(safe, deg=True))}


def fitted_data(frf: FRF, model: ModalModel, rows: NDArray[np.int_]) -> dict[str, Any]:
    """Poles in the state of each run, the run of each position, residues and residual terms."""
    poles, residues = model.poles_and_residues(as_measured=True)
    residues = residues[rows]
    return {
        "band_hz": list(model.fit_band_hz),
        "states": [_parts(model.drift.poles_in(name, poles)) for name in frf.run_names],
        "run": [frf.run_names.index(frf.run[row]) for row in rows],
        "residues": {"real": packed(residues.real), "imag": packed(residues.imag)},
        "lower": packed(model.residual_terms.lower[rows]),
        "upper": packed(model.residual_terms.upper[rows]),
    }


def ring_data(result: Result, rows: NDArray[np.int_]) -> dict[str, Any] | None:
    """Matrices of the tuned ring, order by order, and the angles from the force; None without ring.

    Inertance = −ω²/(2πab) Σ_n M22/(M11·M22 − C²) e^{inθ} with M11 = a_n + jωc_r − ρω²,
    M22 = b_n + jωc_θ − ρω² and C = c_n: the sum over all orders n of the ring at rest
    (`model.inertance`).
    """
    forced = _forced(result)
    if forced is None:
        return None
    ring, damping = forced.ring, forced.damping
    terms = forced.terms(np.arange(forced.highest_order + 1))
    return {
        "m11": _parts(terms.m11),
        "m22": _parts(terms.m22),
        "coupling": _parts(terms.c),
        "mass_per_area_kg_m2": ring.mass_per_area_kg_m2,
        "radial_n_s_m3": damping.radial_n_s_m3,
        "circumferential_n_s_m3": damping.circumferential_n_s_m3,
        "area_m2": 2 * np.pi * ring.mean_radius_m * (ring.belt_width_m or np.nan),
        "angle_rad": _from_force_rad(result)[rows].tolist(),
    }


def _from_force_rad(result: Result) -> NDArray[np.float64]:
    return np.asarray(np.deg2rad(result.frf.position_deg - (result.excitation_deg or 0.0)))


def _hundredths(values: NDArray[np.float64]) -> str:
    lowest = np.iinfo(np.int16).min
    scaled = np.clip(np.round(STEPS_PER_UNIT * values), lowest, -(lowest + 1))
    return b64encode(scaled.astype("<i2").tobytes()).decode("ascii")


def _parts(values: ArrayLike) -> dict[str, list[float]]:
    array = np.asarray(values, dtype=complex)
    return {"real": array.real.tolist(), "imag": array.imag.tolist()}
