"""What the page draws and says of a mode: arrays as float32 after a JSON header, and evidence."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ema.checks.corrections import corrected, kept_rows
from ema.circumference.orders import PURE, circle_basis, highest_order, on_circle, order_basis
from ema.core.display import chance_text, value_with_std
from ema.core.frf import FRF
from ema.core.mac import mac
from ema.core.modes import Mode
from ema.core.settings import IDENTIFICATION
from ema.poles.stability import METHOD_NAMES
from ema.signals.leakage import force_density
from pipelines.plots.modes import forces
from pipelines.results.tables import in_band
from pipelines.review.sight import ModeRow, Sight

_SHOWN_ORDERS = 12
_ALIGNED = 4  # header and arrays start at multiples of so many bytes
_BEYOND = 0.15  # share of the band that is shown beyond its ends
_REAL_SHAPE = 0.9  # MPC below which a shape is complex (Heylen, Lammens, Sas 1997)
_FAR_SIGMA = 3.0


def blob(header: Mapping[str, Any], arrays: Mapping[str, ArrayLike]) -> bytes:
    """A JSON header that names the arrays, after its length, and the arrays."""
    parts = {name: np.asarray(array, dtype="<f4") for name, array in arrays.items()}
    names = [{"name": name, "shape": part.shape} for name, part in parts.items()]
    head = json.dumps({**header, "arrays": names}).encode()
    head += b" " * (-len(head) % _ALIGNED)
    content = b"".join(np.ascontiguousarray(part).tobytes() for part in parts.values())
    return len(head).to_bytes(4, "little") + head + content


def frf_blob(sight: Sight, row: int) -> bytes:
    """One row as it was measured, turned and scaled as it is fitted."""
    sight, own = sight.at(row)
    one = _signed(sight, own)
    lines = _shown(one, sight)
    values = one.values[0, lines]
    arrays = {"frequency_hz": one.frequency_hz[lines], "real": values.real, "imag": values.imag}
    arrays |= {"std": one.std[0, lines], "coherence": one.coherence[0, lines]}
    return blob({"row": row, "unit": "(m/s²)/N", "revision": sight.revision}, arrays)


def fit_blob(sight: Sight, row: int) -> bytes:
    """The fit of one measured row over the fitted lines, and what it leaves in σ."""
    header = {"row": row, "revision": sight.revision, "is_preview": sight.is_preview, "frac": None}
    sight, own = sight.at(row)
    at = np.flatnonzero(kept_rows(sight.measured, sight.corrections) == own)
    if not at.size or not sight.is_fitted:
        nothing = np.zeros(0)
        names = "frequency_hz", "real", "imag", "residual_sigma"
        return blob(header, dict.fromkeys(names, nothing))
    place, model, frf = int(at[0]), sight.model, sight.frf
    lines = in_band(frf.frequency_hz, model.fit_band_hz)
    frequency_hz = frf.frequency_hz[lines]
    fitted = model.synthesise(frequency_hz, frf.run, slice(place, place + 1))[0]
    left = np.abs(frf.values[place, lines] - fitted) / (np.sqrt(2) * frf.std[place, lines])
    arrays = {"frequency_hz": frequency_hz, "real": fitted.real, "imag": fitted.imag}
    return blob({**header, "frac": float(model.frac[place])}, {**arrays, "residual_sigma": left})


def force_blob(sight: Sight, run: str) -> bytes | None:
    """Spectrum of the force of a run; None where it is not stored."""
    of_runs = (each.measured.forces.get(run) for each in sight.of_forces)
    record = next(filter(None, of_runs), None)
    if record is None:
        return None
    frequency_hz = record.plan.frequency_hz
    shown = frequency_hz <= sight.measured.frequency_hz[_shown(sight.measured, sight)][-1]
    arrays = {"frequency_hz": frequency_hz[shown], "psd": force_density(record)[shown]}
    return blob({"run": run, "unit": "N²/Hz"}, arrays)


def diagram_blob(sight: Sight, force: int) -> bytes:
    """Poles of all model orders, their clusters, and indicator functions against a force.

    Poles are those of the first force, which edits name.
    """
    diagram, frf = sight.diagram, sight.of_forces[force].frf
    clusters = [
        {
            **{"label": each.label, "frequency_hz": each.frequency_hz},
            **{"damping_ratio": each.damping_ratio, "kept": each.kept},
            **{"size": each.size, "reason": each.reason},
        }
        for each in diagram.clusters
    ]
    stability = np.where(diagram.stable_frequency, 1 + diagram.stable_damping, 0)
    lines = _shown(frf, sight)
    arrays = {
        **{"frequency_hz": diagram.frequency_hz, "damping_ratio": diagram.damping_ratio},
        **{"model_order": diagram.model_order, "stability": stability},
        **{"cluster": diagram.cluster, "indicator_hz": frf.frequency_hz[lines]},
        "rms": np.sqrt(np.mean(np.abs(frf.values[:, lines]) ** 2, axis=0)),
        "nmif": _nmif(frf.values[:, lines]),
    }
    header = {"band_hz": diagram.band_hz, "clusters": clusters, **sight.poles_asked}
    return blob({**header, "revision": sight.revision}, arrays)


def _nmif(values: NDArray[np.complex128]) -> NDArray[np.float64]:
    """1 − Σ|Re H|·|H| / Σ|H|²: near 1 where all positions move at 90° to the force."""
    size = np.abs(values)
    power = np.sum(size**2, axis=0)
    share = np.sum(np.abs(values.real) * size, axis=0)
    return np.asarray(1 - np.divide(share, power, out=np.ones_like(power), where=power > 0))


def orders_blob(sight: Sight, force: int) -> bytes | None:
    """Size of the FRFs against a force by circumferential orders; None off a circle."""
    frf = sight.of_forces[force].frf
    if not on_circle(frf.position_deg):
        return None
    lines = _shown(frf, sight)
    highest = highest_order(frf.position_deg)
    waves = np.linalg.pinv(circle_basis(frf.position_deg, highest)) @ frf.values[:, lines]
    power = np.abs(waves) ** 2
    levels = [power[0], *(power[k : k + 2].sum(axis=0) for k in range(1, 2 * highest, 2))]
    shown = np.sqrt(np.stack(levels[: _SHOWN_ORDERS + 1]))
    arrays = {"frequency_hz": frf.frequency_hz[lines], "level": shown}
    return blob({"orders": list(range(len(shown))), "revision": sight.revision}, arrays)


def shapes_blob(sight: Sight, force: int) -> bytes:
    """Shapes of the listed modes, of a ring beside each, and their MAC; the same for all forces."""
    modes, angles = sight.model.modes, sight.model.position_deg
    shapes = np.array([mode.shape for mode in modes]).reshape(len(modes), angles.size)
    ring = np.full(shapes.shape, np.nan)
    if on_circle(angles):
        for row, mode in enumerate(modes):
            if mode.order is not None:
                basis = order_basis(angles, mode.order)
                ring[row] = basis @ np.linalg.lstsq(basis, mode.shape.real, rcond=None)[0]
    header = {
        **{"keys": [each.key for each in sight.listed], "orders": [mode.order for mode in modes]},
        **{"rows": kept_rows(sight.measured, sight.corrections).tolist()},
        "revision": sight.revision,
    }
    arrays = {"position_deg": angles, "real": shapes.real, "imag": shapes.imag, "ring": ring}
    return blob(header, {**arrays, "automac": mac(shapes, shapes) if modes else np.zeros((0, 0))})


def _signed(sight: Sight, row: int) -> FRF:
    """A measured row with its correction, also where it is left out."""
    changes = [each for each in sight.corrections if each.row == row and not each.excluded]
    if not changes:
        return sight.measured.rows(np.array([row]))
    kept = kept_rows(sight.measured, changes)
    return corrected(sight.measured, changes).rows(kept == row)


def _shown(frf: FRF, sight: Sight) -> NDArray[np.bool_]:
    """Lines of the fit, and somewhat beyond the band."""
    (low, high), (first, last) = sight.model.band_hz, sight.model.fit_band_hz
    beyond = _BEYOND * (high - low)
    return in_band(frf.frequency_hz, (min(first, low - beyond), max(last, high + beyond)))


@dataclass(frozen=True)
class Line:
    """One piece of evidence."""

    label: str
    value: str
    doubtful: bool | None = None  # None where it is neither good nor bad


def evidence(row: ModeRow, sight: Sight) -> list[Line]:
    """What speaks for and against a mode."""
    mode = row.mode
    return [
        *_poles(mode, sight),
        *_second_opinion(mode, sight),
        *_shape(mode),
        *_strength(mode),
        *_drive(mode, sight),
        *_pair(mode, sight),
        *_band(mode),
        *([Line("Remark", f"{mode.status}: {mode.remark}", True)] if mode.flags else []),
        *_change(row),
    ]


def _poles(mode: Mode, sight: Sight) -> Iterator[Line]:
    clusters = sight.diagram.clusters
    near = min(clusters, key=lambda each: abs(each.pole - mode.pole), default=None)
    highest = int(sight.diagram.model_order.max(initial=0))
    reach = IDENTIFICATION.exclude_reach
    if near is None or abs(near.frequency_hz / mode.frequency_hz - 1) > reach:
        yield Line("Seen at", "no model order; the order by itself shows it", True)
        return
    yield Line("Seen at", f"{near.size} of {highest} model orders", not near.kept)
    if not near.kept:
        yield Line("Its column", near.reason, True)


def _second_opinion(mode: Mode, sight: Sight) -> Iterator[Line]:
    for each in sight.opinions:
        if not np.isfinite(each.mode_hz) or abs(each.mode_hz / mode.frequency_hz - 1) > 1e-6:
            continue
        method = METHOD_NAMES[each.method]
        if not np.isfinite(each.frequency_hz):
            yield Line(f"{method} finds", "nothing there", True)
        else:
            text = f"{each.frequency_hz:.2f} Hz, {100 * each.damping_ratio:.2f} %"
            yield Line(f"{method} finds", text, not each.agrees)


def _shape(mode: Mode) -> Iterator[Line]:
    if np.isfinite(mode.order_purity):
        text = f"{mode.order_purity:.3f} in order {mode.order}"
        yield Line("Purity", text, mode.order_purity < PURE)
    text = f"MPC {mode.mpc:.3f}, phases within {mode.mpd_deg:.1f}°"
    yield Line("Phase", text, mode.mpc < _REAL_SHAPE)


def _strength(mode: Mode) -> Iterator[Line]:
    known = mode.residues_std > 0
    if np.any(known):
        ratio = float(np.max(np.abs(mode.residues[known]) / mode.residues_std[known]))
        yield Line("Residue", f"{ratio:.0f} σ at its largest", ratio < _FAR_SIGMA)


def _drive(mode: Mode, sight: Sight) -> Iterator[Line]:
    """What each of several forces contributes."""
    number = next((k for k, each in enumerate(sight.model.modes, 1) if each is mode), 0)
    names = forces(sight.driven)
    for each in sight.driven:
        if each.mode == number:
            share = f", {100 * each.share:.1f} % of its order" if mode.member else ""
            name = names[each.reference].capitalize()
            yield Line(name, f"{each.drive:.3f} of the strongest drive{share}")


def _pair(mode: Mode, sight: Sight) -> Iterator[Line]:
    if mode.order is None:
        return
    for report in sight.model.orders:
        if report.order == mode.order:
            pair = report.pair
            words = pair.verdict.value or "not looked for", pair.evidence
            yield Line("Pair", "; ".join(filter(None, words)))
            if np.isfinite(pair.chance):
                yield Line("Second mode by chance", chance_text(pair.chance))


def _band(mode: Mode) -> Iterator[Line]:
    shift, std = mode.frequency_band_shift_hz, mode.frequency_std_hz
    if np.isfinite(shift) and np.isfinite(std) and std > 0:
        ratio = abs(shift) / std
        text = f"{value_with_std(shift, None)} Hz ({ratio:.1f} σ)"
        yield Line("With a narrower band", text, ratio > _FAR_SIGMA)


def _change(row: ModeRow) -> Iterator[Line]:
    frequency, damping = row.shift_in_std()
    if np.isfinite(frequency) and np.isfinite(damping):
        text = f"{frequency:+.1f} σ in frequency, {damping:+.1f} σ in damping"
        yield Line("Against automatic", text, max(abs(frequency), abs(damping)) > _FAR_SIGMA)
