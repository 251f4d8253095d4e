"""Speed of the ring model against the plain way to compute the same: python benchmarks/ring.py."""

import time
from collections.abc import Callable

import numpy as np

from model import ForcedRing, bifurcation, harmonics, inertance
from model.parameters import TABLE_4_RING, TABLE_5_DAMPING

ORDERS = np.arange(1, 8)
SPEEDS = np.linspace(0.0, 200.0, 500)
FREQUENCIES = np.linspace(0.1, 300.0, 3000)
ROLLING = ForcedRing(TABLE_4_RING, TABLE_5_DAMPING, 67.3, highest_order=200)


def best_of(function: Callable[[], object], times: int = 5) -> float:
    """Shortest of several runs, s."""
    spent = []
    for _ in range(times):
        start = time.perf_counter()
        function()
        spent.append(time.perf_counter() - start)
    return min(spent)


def roots_one_by_one() -> None:
    terms = harmonics(TABLE_4_RING, ORDERS[:, None], SPEEDS)
    a3, a2, a1, a0 = terms.polynomial
    for square, linear, constant in zip(a2.flat, a1.flat, a0.flat, strict=True):
        np.roots([a3, 0.0, square, linear, constant])


def inertance_one_by_one() -> None:
    omega = 2.0 * np.pi * FREQUENCIES
    for order in ROLLING.orders:
        m11, m12, m22 = (part[0] for part in ROLLING.matrix(np.array([order]), omega))
        matrices = np.moveaxis(np.array([[m11, m12], [-m12, m22]]), -1, 0)
        np.linalg.solve(matrices, np.array([[1.0], [0.0]]))


def report(
    name: str, fast: Callable[[], object], plain: Callable[[], object], limit: float
) -> None:
    spent, reference = best_of(fast), best_of(plain, 1)
    verdict = "within" if spent < limit else "BEYOND"
    print(
        f"{name}: {1e3 * spent:.1f} ms, {verdict} {1e3 * limit:.0f} ms; "
        f"one by one {1e3 * reference:.0f} ms, {reference / spent:.0f} times as long"
    )


if __name__ == "__main__":
    report(
        "7 orders × 500 speeds",
        lambda: bifurcation(TABLE_4_RING, ORDERS, SPEEDS),
        roots_one_by_one,
        0.05,
    )
    report(
        "inertance, 3000 lines, harmonics −200…200",
        lambda: inertance(ROLLING, FREQUENCIES, np.deg2rad(100.0)),
        inertance_one_by_one,
        0.1,
    )
