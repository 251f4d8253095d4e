"""Travelling waves of the free ring and how they look from three reference systems."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.arrays import finite_array
from model.coefficients import characteristic_roots, eigenvector_ratios
from model.errors import InstabilityError, ParameterError
from model.parameters import RingParameters
from model.rotation import wave_orders
from model.steady_state import PressureLoad

#: Reference systems: on the wheel, in space, and turning so that the pair stands (eq 29).
WaveFrame = Literal["rotating", "absolute", "stationary"]


@dataclass(frozen=True)
class WavePair:
    """The regressive and the progressive wave of one order at one speed.

    Parameters
    ----------
    order : int
        Circumferential order n ≥ 1.
    speed_rad_s : float
        Angular speed Ω of the wheel, rad/s.
    regressive_rad_s, progressive_rad_s : float
        ω_{n,1} and ω_{n,2} (ω_{n,3} and ω_{n,4} for the extensional pair), rotating frame, rad/s.
    regressive_ratio, progressive_ratio : float
        B_{n,1} and B_{n,2}: circumferential over radial amplitude of each wave; negative for the
        extensional pair, whose sign Table 2 writes out.
    """

    order: int
    speed_rad_s: float
    regressive_rad_s: float
    progressive_rad_s: float
    regressive_ratio: float
    progressive_ratio: float

    @property
    def beta_rad_s(self) -> float:
        """Speed β of the stationary frame against the rotating one (eq 32), rad/s."""
        return (self.progressive_rad_s - self.regressive_rad_s) / (2.0 * self.order)

    def frame_speed_rad_s(self, frame: WaveFrame) -> float:
        """Angular speed of a reference system against the rotating one, rad/s.

        Zero for "rotating", −Ω for "absolute" (eq 1c: θ = φ − Ωt), β for "stationary" (eq 29).
        """
        speeds = {
            "rotating": 0.0,
            "absolute": -self.speed_rad_s,
            "stationary": self.beta_rad_s,
        }
        if frame not in speeds:
            raise ParameterError(
                "frame", f"{frame!r}", f"one of {', '.join(speeds)}", "Choose one of them"
            )
        return speeds[frame]

    def frequencies_rad_s(self, frame: WaveFrame) -> tuple[float, float]:
        """Frequencies seen from `frame`: regressive, progressive (eqs 21, 25, 30), rad/s."""
        drift = self.order * self.frame_speed_rad_s(frame)
        return self.regressive_rad_s + drift, self.progressive_rad_s - drift

    def propagation_speeds_rad_s(self, frame: WaveFrame) -> tuple[float, float]:
        """Speeds c_{n,1} and c_{n,2} of the two waves (eqs 23, 26 without its modulus, 31), rad/s.

        The regressive wave travels towards negative angles, the progressive one towards positive.
        """
        regressive, progressive = self.frequencies_rad_s(frame)
        return regressive / self.order, progressive / self.order

    def pattern_speed_rad_s(self, frame: WaveFrame) -> float:
        """Speed c_{n,tot} at which the superposed pattern turns (eqs 24 and 28), rad/s.

        Zero in the stationary frame.
        """
        regressive, progressive = self.propagation_speeds_rad_s(frame)
        return abs(regressive - progressive) / 2.0

    def radial(
        self, angles_rad: ArrayLike, times_s: ArrayLike, frame: WaveFrame = "rotating"
    ) -> NDArray[np.float64]:
        """Superposed radial field u_{r,tot} (eqs 19a, 20a, 21a, 22a, 25a, 27a, 30a).

        Parameters
        ----------
        angles_rad : array_like, shape (n_angles,)
            Angles θ, φ or γ in the chosen frame, rad.
        times_s : array_like, shape (n_times,)
            Times, s.
        frame : {"rotating", "absolute", "stationary"}
            Reference system.

        Returns
        -------
        ndarray, shape (n_angles, n_times)
            2cos(nθ + ω_{n,1}t) + 2cos(nθ − ω_{n,2}t), without unit.
        """
        backward, forward = self._phases(angles_rad, times_s, frame)
        return np.asarray(2.0 * np.cos(backward) + 2.0 * np.cos(forward))

    def circumferential(
        self, angles_rad: ArrayLike, times_s: ArrayLike, frame: WaveFrame = "rotating"
    ) -> NDArray[np.float64]:
        """Superposed field u_{θ,tot} (eqs 19b, 20b, 21b, 22b, 25b, 27b, 30b as corrected).

        The second term of eq 30b is −2B_{n,2} sin(nγ − (ω_{n,2} − nβ)t). Eqs 22b and 27b take
        B_{n,2} = B_{n,1}, which is exact at Ω = 0 only. Arguments and shape as `radial`.
        """
        backward, forward = self._phases(angles_rad, times_s, frame)
        regressive = -2.0 * self.regressive_ratio * np.sin(backward)
        return np.asarray(regressive - 2.0 * self.progressive_ratio * np.sin(forward))

    def _phases(
        self, angles_rad: ArrayLike, times_s: ArrayLike, frame: WaveFrame
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        around = self.order * np.atleast_1d(finite_array("angles_rad", angles_rad))[:, None]
        times = np.atleast_1d(finite_array("times_s", times_s))
        regressive, progressive = self.frequencies_rad_s(frame)
        return around + regressive * times, around - progressive * times


def wave_pair(
    ring: RingParameters,
    order: int,
    speed_rad_s: float = 0.0,
    *,
    extensional: bool = False,
    pressure_load: PressureLoad = "dead",
) -> WavePair:
    """Both waves of an order: roots and eigenvectors of eqs 12 and 14 by Tables 1 and 2.

    Parameters
    ----------
    ring : RingParameters
        The ring.
    order : int
        Circumferential order n ≥ 1.
    speed_rad_s : float
        Angular speed Ω, rad/s.
    extensional : bool
        Whether to take the extensional pair.
    pressure_load : {"dead", "follower"}
        See `equilibrium`.

    Returns
    -------
    WavePair
        With real frequencies.

    Raises
    ------
    InstabilityError
        Where a root is complex.
    """
    n = int(wave_orders(order)[0])
    roots = characteristic_roots(ring, n, speed_rad_s, pressure_load=pressure_load)
    ratios = eigenvector_ratios(ring, n, speed_rad_s, pressure_load=pressure_load)
    first = 2 if extensional else 0
    growth = float(np.abs(roots[first : first + 2].imag).max())
    if growth > 0:
        raise InstabilityError(
            f"order {n} at {speed_rad_s:g} rad/s",
            f"a root grows by {growth:.4g} 1/s",
            "an unstable ring has no natural frequency",
            "Lower the speed",
        )
    return WavePair(
        order=n,
        speed_rad_s=float(speed_rad_s),
        regressive_rad_s=float(roots[first].real),
        progressive_rad_s=float(-roots[first + 1].real),
        regressive_ratio=float(ratios[first]),
        progressive_ratio=float(ratios[first + 1]),
    )
