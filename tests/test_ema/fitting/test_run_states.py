"""States of the runs: chance or drift."""

import numpy as np

from ema.core.drift import lever_at
from ema.core.settings import IDENTIFICATION
from ema.fitting.run_states import _Shifts

N_RUNS, NOISE = 6, 0.001  # half-widths
HZ = np.array([75.0, 99.0, 121.0, 147.0, 175.0, 206.0, 238.0, 272.0, 307.0])
DAMPING = 1 / np.array([27.7, 34.1, 37.6, 40.0, 42.6, 45.6, 48.4, 49.8, 50.8])
# Shifts in 10⁻⁴ half-widths of a steady laboratory tyre whose sensors are 0.1° off: orders 2 and 4
# stray in the first run, orders 5 to 7 in the fourth.
STRAYS = 1e-4 * np.array([
    [6, 222, -27, 203, -47, 49, -44, 12, 47],
    [-17, 5, 16, 19, -34, 45, -42, 22, 66],
    [-9, -55, -14, -49, -17, 39, -35, -7, -14],
    [57, -84, 42, -42, 120, -171, 115, 6, -61],
    [-18, -58, -7, -67, 3, 7, -21, -18, -11],
    [-18, -28, -11, -65, -25, 32, 28, -15, -26],
])  # fmt: skip
# The same of another one, whose other orders keep still: the test alone told a drift of 0.05 %.
TWO_STRAY = 1e-4 * np.array([
    [9, 373, -37, 309, 0, 5, -10, 15, 36],
    [-25, -50, -30, -65, 12, 15, -5, -1, 19],
    [-17, -90, -19, -78, -7, -24, -10, -6, -9],
    [80, -112, 68, -91, 9, 46, 56, 0, -54],
    [-17, -86, -29, -78, -7, -34, -24, 2, 38],
    [-31, -35, 46, 3, -6, -9, -6, -9, -30],
])  # fmt: skip
OF_DAMPING = 1e-4 * np.array([
    [23, -34, -8, -29, -38, 38, -15, 21, 17],
    [-17, 29, -21, 18, -66, -3, -9, 21, -23],
    [-4, 3, 31, 2, -23, 58, -7, 25, -6],
    [19, 9, -6, 39, 87, -68, -42, -42, 21],
    [0, 0, -22, -22, 8, -46, 63, 2, 18],
    [-21, -8, 26, -8, 32, 21, 10, -26, -26],
])  # fmt: skip


def shifts(of_frequency, drift_percent=0.0):
    """Orders that keep to a drift by their tension, but for what single ones stray in a run."""
    n, lever = HZ.size, lever_at(HZ, 143.0)
    law = np.zeros((2 * n, 4))
    law[:n, :3] = np.stack([lever**0, lever, lever**2], axis=1) / DAMPING[:, None]
    law[n:, 3] = 1.0
    away = np.concatenate([of_frequency, OF_DAMPING], axis=1)
    away += np.outer(np.linspace(0, drift_percent / 100, N_RUNS), law[:, 0])
    noise = np.tile(NOISE**2 * np.eye(2 * n), (N_RUNS, 1, 1))
    return _Shifts(away, noise, law, [0, 1, 2, 3])


def chance_of(found):
    return found.chance(found.spread())


def test_orders_that_stray_one_by_one_are_no_drift():
    assert chance_of(shifts(STRAYS)) > 0.01


def test_what_most_orders_do_not_follow_is_no_drift():
    assert chance_of(shifts(TWO_STRAY)) > 0.01
    assert chance_of(shifts(TWO_STRAY, drift_percent=0.1)) < IDENTIFICATION.drift_p_value


def test_a_drift_is_seen_beside_orders_that_stray():
    assert chance_of(shifts(STRAYS, drift_percent=0.1)) < IDENTIFICATION.drift_p_value


def test_a_drift_is_seen_beside_one_order_that_strays_far():
    random = np.random.default_rng(6)
    for _ in range(20):
        strays = 0.003 * random.standard_normal((N_RUNS, HZ.size))
        strays[:, 4] *= 20
        assert chance_of(shifts(strays, drift_percent=0.05)) < IDENTIFICATION.drift_p_value
