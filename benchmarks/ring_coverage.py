"""Coverage of the ± of ring parameters over random tyres: python benchmarks/ring_coverage.py."""

import argparse
from collections import defaultdict

import numpy as np

import model
from model.parameters import DAMPING_NAMES, RingDamping, RingParameters

RING = (
    "mass_per_area_kg_m2",
    "radial_stiffness_n_m3",
    "circumferential_stiffness_n_m3",
    "axial_stiffness_n_m",
    "bending_stiffness_n_m",
)
ORDERS = np.arange(1, 9)
WIDTH_M = 0.2
#: Radius m, pressure Pa, mass per area kg/m², order 1 Hz, bending D/(ρh) — low and high.
KINDS = {
    "bicycle": ((0.30, 0.34), (3e5, 7e5), (1.5, 4.0), (60.0, 140.0), (0.02, 0.3)),
    "motorcycle": ((0.27, 0.33), (1.9e5, 2.9e5), (8.0, 14.0), (60.0, 120.0), (0.1, 0.6)),
    "car": ((0.28, 0.37), (1.8e5, 3.0e5), (12.0, 25.0), (60.0, 100.0), (0.2, 0.8)),
    "truck": ((0.42, 0.52), (6e5, 9e5), (30.0, 60.0), (45.0, 80.0), (0.4, 1.5)),
}


def random_tyre(rng: np.random.Generator) -> tuple[RingParameters, RingDamping]:
    """A tyre of any kind that grows by 0.05 to 1 %."""
    kind = KINDS[rng.choice(list(KINDS))]
    radius, pressure, mass, first_hz, bending = (rng.uniform(*limits) for limits in kind)
    growth = np.exp(rng.uniform(*np.log([0.0005, 0.01])))
    both = 2.0 * mass * (2.0 * np.pi * first_hz) ** 2
    share = rng.uniform(0.05, 0.35)
    k_r, k_t = (1.0 - share) * both, share * both
    # The belt carries the tension that its growth needs; what the bed carries is less than half.
    growth = min(growth, 0.5 * pressure / (k_r * radius))
    carried = pressure - k_r * growth * radius
    axial = carried * radius / (growth * (1.0 + 1.5 * growth + 0.5 * growth**2))
    ring = RingParameters(radius, mass, k_r, k_t, axial, bending * mass, pressure, WIDTH_M)
    omega = 2.0 * np.pi * first_hz * mass
    damping = RingDamping(
        rng.uniform(0.02, 0.12) * omega, rng.uniform(0.02, 0.12) * omega, rng.uniform(0.01, 0.05)
    )
    return ring, damping


def tuned(ring: RingParameters, damping: RingDamping, rng: np.random.Generator, **how):
    """Parameters found, standard deviations and how, from what a test would measure."""
    noise, wrong, masses, orders = how["noise"], how["wrong"], how["masses"], how["orders"]
    hz = model.natural_frequencies_hz(ring, orders, pressure_load=how["load"])
    ratios = model.damping_ratios(ring, damping, orders, pressure_load=how["load"])
    hz = hz * (1 + noise * rng.standard_normal(hz.size))
    ratios = ratios * (1 + 5 * noise * rng.standard_normal(hz.size))
    known = {"mean_radius_m": 0.005, "inflation_pressure_pa": 0.01}
    tyre = {
        name: getattr(ring, name) * (1 + wrong * std * rng.standard_normal())
        for name, std in known.items()
    }
    if masses:
        mass = model.modal_mass_kg(ring, orders, pressure_load=how["load"])
        scale = 1 + 0.005 * rng.standard_normal()
        tyre["modal_mass_kg"] = mass * scale * (1 + 0.001 * rng.standard_normal(mass.size))
        tyre["modal_mass_std_kg"] = 0.001 * mass
        if masses == "width":
            tyre["belt_width_m"] = WIDTH_M * (1 + wrong * 0.03 * rng.standard_normal())
    std = max(noise, 1e-5)
    found = model.tune_ring(
        orders, hz, frequency_std_hz=std * hz, pressure_load=how["load"], **tyre
    )
    damped = model.identify_damping(
        found.ring,
        orders,
        ratios,
        5 * std * ratios,
        pressure_load=how["load"],
        ring_covariance=(found.std, found.covariance),
    )
    return found, damped


SCENARIOS = {
    "exact": {},
    "noise 0.1 %": {"noise": 0.001},
    "noise 0.5 %": {"noise": 0.005},
    "p0, a wrong": {"noise": 0.001, "wrong": 1.0},
    "p0, a wrong, follower": {"noise": 0.001, "wrong": 1.0, "load": "follower"},
    "4 orders": {"noise": 0.001, "orders": np.arange(1, 5)},
    "5 orders": {"noise": 0.001, "orders": np.arange(1, 6)},
    "masses, width": {"noise": 0.001, "wrong": 1.0, "masses": "width"},
    "masses, no width": {"noise": 0.001, "wrong": 1.0, "masses": "alone"},
}
BASE = {"noise": 0.0, "wrong": 0.0, "masses": "", "load": "dead", "orders": ORDERS}


def coverage(name: str, n_tyres: int) -> None:
    """Print the share of true values within 1.96 standard deviations, and false claims."""
    inside, sizes = defaultdict(list), defaultdict(list)
    claims, states, false, belt = defaultdict(int), defaultdict(int), [], []
    for seed in range(n_tyres):
        rng = np.random.default_rng(seed)
        ring, damping = random_tyre(rng)
        found, damped = tuned(ring, damping, rng, **BASE | SCENARIOS[name])
        states[found.verdict.state.value] += 1
        for key in (*RING, *DAMPING_NAMES):
            of_ring = key in RING
            true = getattr(ring if of_ring else damping, key)
            value = getattr(found.ring if of_ring else damped.damping, key)
            how, std = ((found if of_ring else damped).how[key], (found if of_ring else damped).std)
            claims[key] += how == "identified"
            if how == "identified" and abs(value - true) > 0.5 * value:
                false.append(f"{key} of tyre {seed}")
            if key in std and (key != "axial_stiffness_n_m" or how == "identified"):
                inside[key].append(abs(value - true) <= 1.96 * std[key])
                sizes[key].append(100 * std[key] / true)
        if (width := found.ring.belt_width_m) is not None:
            line = width * found.ring.mass_per_area_kg_m2 * found.ring.mean_radius_m
            true = WIDTH_M * ring.mass_per_area_kg_m2 * ring.mean_radius_m
            belt.append(100 * (line / true - 1))
    print(f"{name}: {dict(states)}, false claims: {', '.join(false) or 'none'}")
    for key, hits in inside.items():
        print(
            f"  {key:32s} {100 * np.mean(hits):5.1f} % of {len(hits)}, "
            f"identified {claims[key]}, median ± {np.median(sizes[key]):.2g} %"
        )
    if belt:
        print(f"  belt mass off by {np.std(belt):.2f} % rms, at most {np.abs(belt).max():.2f} %")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenarios", nargs="*", default=list(SCENARIOS))
    parser.add_argument("--tyres", type=int, default=200)
    chosen = parser.parse_args()
    for each in chosen.scenarios:
        coverage(each, chosen.tyres)
