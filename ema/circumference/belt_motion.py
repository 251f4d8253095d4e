"""How the belt of a ring moves along the circumference, and the pull of masses on it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]

# √(K/ρh)/(2πa), frequency of extension of a belt, where order 0 does not show it: that of the
# paper's tyre (Table 4). None is softer than one that grows by 2 % when inflated.
_STRETCH_HZ, _SOFTEST_HZ = 545.0, 250.0
# √(k_r/ρh)/2π: the bed alone, of the paper's tyre; a thirtieth of the stiffness of the breathing.
_BED_HZ = 100.0
# √(k_θ/ρh)/2π, torsion of a belt on its rim: that of rings of car tyres, 30 to 60 Hz.
_TORSION_HZ = 45.0
# Lines below the breathing, where order 0 answers by its stiffness.
_STIFF_HZ = 300.0
# Orders whose resonances tell the mass of the ring, 2 to 6: a rim moves order 1.
_WEIGHED = slice(1, 6)


def stretch_hz(frequency_hz: Real, breathing: Complex, mass_kg: Real, noise: Real) -> float:
    """Frequency of extension of a belt from the inertance of order 0 and the orders' modal masses.

    Order 0 stretches the belt evenly: its inertance is ω²/(M (ω² − ω_0²)), with the mass M of the
    ring, of which order n moves (1 + 1/n²)/2, and ω_0² = (K/a² + k_r)/ρh. `mass_kg` are those of
    orders 1, 2 …, `noise` is that of each line.
    """
    order = np.arange(1, mass_kg.size + 1)
    whole = (2.0 * mass_kg / (1.0 + 1.0 / order**2))[_WEIGHED]
    lines = (frequency_hz > 0) & (frequency_hz < _STIFF_HZ) & (np.abs(breathing) > 0)
    if not np.any(lines) or not np.all(whole > 0):
        return _STRETCH_HZ
    square = frequency_hz[lines] ** 2
    softness = 1.0 / (square * (1.0 - (1.0 / breathing[lines]).real / np.median(whole)))
    rising = np.argsort(softness)
    share = np.cumsum((square / noise[lines])[rising])
    middle = softness[rising[np.searchsorted(share, share[-1] / 2)]]
    softest, stiffest = np.hypot(_SOFTEST_HZ, _BED_HZ), 1e3 * _STRETCH_HZ
    breathing_hz = 1.0 / np.sqrt(np.clip(middle, stiffest**-2, softest**-2))
    return float(np.sqrt(breathing_hz**2 - _BED_HZ**2))


def pull_on_waves(
    mass_kg: Real,
    seats: Real,
    radial: Complex,
    waves: Complex,
    frequency_hz: Real,
    stretch_hz: float,
) -> Complex:
    """Pull of the masses at the seats on each wave, (n_waves, n_frequencies).

    A sensor moves along the belt too. A belt that does not stretch moves v = −w'/n² (Kim, Nam &
    Lee 2020; v' = −w): for order n the tangential pull adds about 1/n² of the radial one. Its own
    inertia, less the pull of the bed, stretches it: v is larger by (ρhω² − k_θ)a²/(n²K), 1 to 2 %
    for order 1.
    """
    order = np.arange(1, (seats.shape[1] + 1) // 2)
    along = np.zeros_like(seats)
    along[:, 1::2], along[:, 2::2] = -seats[:, 2::2] / order, seats[:, 1::2] / order
    stretch = np.ones((seats.shape[1], frequency_hz.size))
    inertia = frequency_hz**2 - _TORSION_HZ**2
    stretch[1:] += inertia / (stretch_hz * np.repeat(order, 2)[:, None]) ** 2
    tangential = along @ (stretch * waves)
    return np.asarray((mass_kg * seats.T) @ radial + stretch * ((mass_kg * along.T) @ tangential))
