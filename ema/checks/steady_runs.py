"""What a tyre that changes within a run does to its modes: findings, and damping ratios without it.

Damping ratios are corrected for what a change adds (docs/identification.md, "Change within a run").
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ema.core.finding import Check, Finding, Verdict
from ema.core.modes import ModalModel
from ema.core.settings import CHECKS, CheckSettings
from ema.signals.steadiness import PIECE_S, Estimate, ModeChange, Steadiness

# What one pole makes of a spread of frequencies, see `_widening`: fits of tyres give 1.1 to 1.7. An
# uneven change, an exponential one over two time constants, spreads them by 6 % more.
_ONE_POLE, _ONE_POLE_STD = 1.4, 0.15
# A run shows the state of its middle, within so much of its length (1 σ): blocks and force are not
# the same all along. Noise 0.03, hits 0.04, sweeps 0.07.
_MIDDLE = 0.05


def steadiness_findings(
    found: Sequence[Steadiness], model: ModalModel, settings: CheckSettings = CHECKS
) -> list[Finding]:
    """Findings about changes within each run, and about the dependence on level."""
    findings = [_within_run(each, model, settings) for each in found]
    levels = [each.over_level for each in found if each.over_level is not None]
    return findings + ([_level(levels, settings)] if levels else [])


def without_changes_within_runs(
    model: ModalModel, found: Sequence[Steadiness], settings: CheckSettings = CHECKS
) -> ModalModel:
    """The modes with the damping that they have while nothing changes, and with a ± for it.

    Parameters
    ----------
    model : ModalModel
        Fitted to FRFs of whole runs.
    found : sequence of Steadiness
        Of all runs, steady ones as well.
    settings : CheckSettings
    """
    changes = [_changes(each, model.frequencies_hz, settings) for each in found]
    if not np.any(changes):
        return model
    value, std = np.swapaxes(changes, 0, 1)
    poles = np.array([mode.pole for mode in model.modes])
    # By chance, what is found is larger than the change.
    decay = _decay_at_rest(poles, np.mean(np.maximum(value**2 - std**2, 0.0), axis=0))
    widened = -poles.real - decay
    square_std = np.sqrt(np.sum((4 * value**2 + 2 * std**2) * std**2, axis=0)) / len(changes)
    unsure = np.hypot(_ONE_POLE_STD, widened / decay) * widened, _widening(poles, square_std, decay)
    damping_std = np.hypot(*unsure) / np.abs(poles)
    still = -decay + 1j * np.sqrt(np.abs(poles) ** 2 - decay**2)
    hz_std = _MIDDLE * np.abs(value.mean(axis=0)) * model.frequencies_hz
    modes = [
        replace(
            mode,
            pole=complex(pole),
            frequency_std_hz=float(np.hypot(mode.frequency_std_hz, hz)),
            damping_std=float(np.hypot(mode.damping_std, ratio)),
        )
        for mode, pole, hz, ratio in zip(model.modes, still, hz_std, damping_std, strict=True)
    ]
    covariance = np.array(model.covariance)
    covariance[np.diag_indices_from(covariance)] += np.ravel((hz_std, damping_std), "F") ** 2
    share = widened / -poles.real
    nearest = [np.argmin(np.abs(model.frequencies_hz - each.frequency_hz)) for each in model.orders]
    return replace(
        model,
        modes=tuple(modes),
        covariance=covariance,
        orders=tuple(
            replace(
                each,
                damping_ratio=float(each.damping_ratio * (1 - share[k])),
                damping_std=float(np.hypot(each.damping_std, damping_std[k])),
            )
            for each, k in zip(model.orders, nearest, strict=True)
        ),
        widened_per_s=widened,
    )


def _widening(
    poles: NDArray[np.complex128], square: NDArray[np.float64], decay: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Decay rate that frequencies seem to add which change evenly by a share, here its square.

    The mean of 1/(jω − s) over s with variance v = (ω change)²/12 is 1/(jω − s) − v/(jω − s)³. One
    pole that is fitted to it decays faster by v/σ by least squares over all lines, by 2v/σ at the
    peak alone.
    """
    return np.asarray(_ONE_POLE * np.abs(poles) ** 2 * square / (12 * decay))


def _decay_at_rest(
    poles: NDArray[np.complex128], square: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Decay rates of which, together with their widening, those of the poles are made."""
    seen = -poles.real
    rest = np.maximum(seen**2 - 4 * seen * _widening(poles, square, seen), 0.0)
    return np.asarray((seen + np.sqrt(rest)) / 2)


def _changes(
    seen: Steadiness, frequency_hz: NDArray[np.float64], settings: CheckSettings
) -> NDArray[np.float64]:
    """Change of each mode within a run and its standard deviation, (2, n); 0 if it is chance."""
    if not seen.over_time.is_clear(settings):
        return np.zeros((2, frequency_hz.size))
    common = seen.over_time
    every = seen.of_modes or (ModeChange(1.0, common.value, common.std),)
    known_hz = np.array([each.frequency_hz for each in every])
    nearest = np.abs(np.log(frequency_hz[:, None] / known_hz)).argmin(axis=1)
    value, std = np.array([(each.value, each.std) for each in every])[nearest].T
    # Before it was looked at, a mode may have changed by 0 to 2 times what all do (1 σ).
    trust = common.value**2 / (common.value**2 + std**2)
    return np.stack([trust * value + (1 - trust) * common.value, np.sqrt(trust) * std])


def _within_run(seen: Steadiness, model: ModalModel, settings: CheckSettings) -> Finding:
    found, verdict = seen.over_time, Verdict.OK
    detail = (
        f"natural frequencies {100 * found.value:+.3f} ± {100 * found.std:.3f} % from start to end"
    )
    if found.is_clear(settings):
        poles = np.array([mode.pole for mode in model.modes])
        decay = _decay_at_rest(poles, _changes(seen, model.frequencies_hz, settings)[0] ** 2)
        broader = -poles.real / decay - 1
        mode = model.modes[int(np.argmax(broader))]
        detail += (
            "; frequencies are those of the middle of the run, and damping ratios are corrected: "
            f"as recorded, up to {100 * broader.max():.2g} % too high (at {mode.frequency_hz:.0f} "
            "Hz)"
        )
        if abs(found.value) >= settings.steady_change:
            verdict = Verdict.WARNING
            detail += ". Let the tyre settle (temperature, pressure), or record less at a time"
    else:
        detail += "; no more than chance"
    return Finding(seen.run, "", None, Check.WITHIN_RUN, verdict, detail)


def _level(found: Sequence[Estimate], settings: CheckSettings) -> Finding:
    """Dependence on level, of all runs together."""
    value, std = np.array([(each.value, each.std) for each in found]).T
    weight = 1 / np.maximum(std, 1e-12) ** 2
    mean = float(np.average(value, weights=weight))
    # Runs that differ by more than their own ± count by how they differ.
    spread = float(np.sum(weight * (value - mean) ** 2)) / max(len(found) - 1, 1)
    error = float(np.sqrt(max(1.0, spread) / weight.sum()))
    common = Estimate(mean, error, sum(each.freedom for each in found))
    verdict = Verdict.OK
    detail = f"natural frequencies {100 * mean:+.3f} ± {100 * error:.3f} % where the level doubles"
    if not common.is_clear(settings):
        detail += "; no more than chance"
    elif abs(mean) >= settings.steady_change / 2:
        verdict, softer = Verdict.WARNING, "softer" if mean < 0 else "stiffer"
        detail += (
            f" for {PIECE_S:g} s, and more where it stays high: the tyre is {softer} at higher "
            "level. Modes hold for the level of this test, and damping ratios are too high; "
            "compare with a test at another level"
        )
    return Finding("", "", None, Check.LEVEL_DEPENDENCE, verdict, detail)
