"""Compensation of an exponential window: fitted poles without the damping that it added.

A window e^{−t/τ} on the response turns H(s) into H(s + 1/τ): with H = s² Σ A/(s − s_r), every pole
moves by −1/τ and the factor s² becomes (s + 1/τ)². The factor is taken from the FRFs, the damping
from the poles: dividing the responses by the window would amplify their noise.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ema.core.block_plan import ExponentialWindow
from ema.core.display import number
from ema.core.errors import FitError
from ema.core.frf import FRF
from ema.core.modes import ModalModel, Mode, OrderReport


def with_own_factor(frf: FRF) -> FRF:
    """FRFs with the factor s² that inertances have, in the place of (s + 1/τ)²."""
    if frf.exponential_window is None:
        return frf
    s = 2j * np.pi * frf.frequency_hz
    factor = (s / (s + frf.exponential_window.decay_per_s)) ** 2
    return replace(frf, values=frf.values * factor, std=frf.std * np.abs(factor))


def without_window(model: ModalModel, window: ExponentialWindow | None) -> ModalModel:
    """Modes with the damping of the tyre alone; modes that this leaves undamped are not listed.

    Parameters
    ----------
    model : ModalModel
        Fitted to FRFs with the window.
    window : ExponentialWindow or None

    Raises
    ------
    FitError
        If the window adds more damping than any mode has.
    """
    if window is None:
        return model
    decay = window.decay_per_s
    damped = [k for k, mode in enumerate(model.modes) if -mode.pole.real > decay]
    if not damped:
        raise FitError(
            f"all modes decay more slowly than the exponential window of "
            f"{window.time_constant_s:g} s alone. Correct exponential_window_s."
        )
    kept = np.ravel([(2 * k, 2 * k + 1) for k in damped])
    modes = [_compensated(model.modes[k], decay) for k in damped]
    covariance = model.covariance[np.ix_(kept, kept)] + _of_window(modes, window)
    std = np.sqrt(np.diag(covariance)).reshape(-1, 2)
    undamped = [mode for k, mode in enumerate(model.modes) if k not in damped]
    return replace(
        model,
        modes=tuple(
            replace(mode, frequency_std_hz=float(f), damping_std=float(ratio))
            for mode, (f, ratio) in zip(modes, std, strict=True)
        ),
        guard_modes=tuple(_compensated(mode, decay) for mode in (*undamped, *model.guard_modes)),
        covariance=covariance,
        orders=tuple(_compensated_order(each, window) for each in model.orders),
        exponential_window=window,
        notes=(*model.notes, _note(modes, window), *map(_not_listed, undamped)),
    )


def _compensated(mode: Mode, decay_per_s: float) -> Mode:
    return replace(mode, pole=mode.pole + decay_per_s)


def _of_window(modes: list[Mode], window: ExponentialWindow) -> NDArray[np.float64]:
    """Covariance of (frequency_hz, damping_ratio) from that of τ, which all modes share."""
    poles = np.array([mode.pole for mode in modes])
    size = np.abs(poles)
    slope = np.ravel(np.column_stack([poles.real / size / (2 * np.pi), -(poles.imag**2) / size**3]))
    return np.asarray(window.decay_std_per_s**2 * np.outer(slope, slope))


def _compensated_order(report: OrderReport, window: ExponentialWindow) -> OrderReport:
    omega = 2 * np.pi * report.frequency_hz
    return replace(
        report,
        damping_ratio=report.damping_ratio - window.decay_per_s / omega,
        damping_std=float(np.hypot(report.damping_std, window.decay_std_per_s / omega)),
    )


def _note(modes: list[Mode], window: ExponentialWindow) -> str:
    low, high = modes[0], modes[-1]
    added = [100 * window.decay_per_s / abs(mode.pole) for mode in (low, high)]
    known = f" ± {window.std_s:g}" if window.std_s else ""
    return (
        f"The damping of the exponential window ({window.time_constant_s:g}{known} s) is "
        f"compensated: −{number(added[0])} % of critical at {low.frequency_hz:.0f} Hz, "
        f"−{number(added[1])} % at {high.frequency_hz:.0f} Hz. FRFs and stability diagram are as "
        "measured."
    )


def _not_listed(mode: Mode) -> str:
    return (
        f"The pole at {mode.frequency_hz:.1f} Hz is fitted but not listed: it decays more slowly "
        "than the exponential window alone."
    )
