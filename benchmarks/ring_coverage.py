"""Coverage of the ± of ring parameters over random tyres, and whether faults are told.

python benchmarks/ring_coverage.py "noise 0.1 %" --tyres 200
python benchmarks/ring_coverage.py "wrong order" "shifted orders" "band cut" --tyres 20
"""

import argparse
import itertools
from collections import defaultdict

import numpy as np

import model
from model.parameters import DAMPING_NAMES, RingDamping, RingParameters, TuningPriors

RING = (
    "mass_per_area_kg_m2",
    "radial_stiffness_n_m3",
    "circumferential_stiffness_n_m3",
    "axial_stiffness_n_m",
    "bending_stiffness_n_m",
)
ORDERS = np.arange(1, 9)
WIDTH_M = 0.2
CALIBRATION = 0.005  # of modal masses, rms: the floor of the belt mass where no width is given
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


def growth_m(ring: RingParameters) -> float:
    """Radial growth on inflation under a dead pressure, m."""
    return float(model.equilibrium(ring).radius_m) - ring.mean_radius_m


def tuned(ring: RingParameters, damping: RingDamping, rng: np.random.Generator, **how):
    """Ring and damping found from what a test would measure, and the error of its calibration."""
    noise, wrong, masses, orders = how["noise"], how["wrong"], how["masses"], how["orders"]
    hz = model.natural_frequencies_hz(ring, orders, pressure_load=how["load"])
    ratios = model.damping_ratios(ring, damping, orders, pressure_load=how["load"])
    hz = hz * (1 + how["form"] * rng.standard_normal(hz.size))
    hz = hz * (1 + noise * rng.standard_normal(hz.size))
    hz *= 1 + how["order_1"] * rng.standard_normal() * (orders == 1)
    ratios = ratios * (1 + 5 * noise * rng.standard_normal(hz.size))
    stated = {"pressure_std": 0.01 * wrong, "radius_std": 0.005 * wrong}
    stated["order_1_std"] = how["order_1"]
    known = {"mean_radius_m": 0.005, "inflation_pressure_pa": 0.01}
    tyre = {
        name: getattr(ring, name) * (1 + wrong * std * rng.standard_normal())
        for name, std in known.items()
    }
    scale = 1.0
    if masses:
        mass = model.modal_mass_kg(ring, orders, pressure_load=how["load"])
        drawn = rng.standard_normal()
        scale = 1 + CALIBRATION * (drawn if how["calibration"] is None else how["calibration"])
        tyre["modal_mass_kg"] = mass * scale * (1 + 0.001 * rng.standard_normal(mass.size))
        tyre["modal_mass_std_kg"] = 0.001 * mass
        if masses == "width":
            tyre["belt_width_m"] = WIDTH_M * (1 + wrong * 0.03 * rng.standard_normal())
    if how["growth"]:  # measured by a tape or a laser, to a tenth
        growth = growth_m(ring) * (1 + 0.1 * rng.standard_normal())
        tyre |= {"radial_growth_m": growth, "radial_growth_std_m": 0.1 * growth_m(ring)}
    if how["torsion"]:
        torsion = model.torsion_frequency_hz(ring, pressure_load=how["load"])
        torsion *= 1 + np.hypot(noise, how["form"]) * rng.standard_normal()
        tyre |= {"torsion_hz": torsion, "torsion_std_hz": noise * torsion}
    std = max(noise, 1e-5)
    found = model.tune_ring(
        orders,
        hz,
        frequency_std_hz=std * hz,
        pressure_load=how["load"],
        priors=TuningPriors(**({} if how["defaults"] else stated)),
        **tyre,
    )
    damped = model.identify_damping(
        found.ring,
        orders,
        ratios,
        5 * std * ratios,
        pressure_load=how["load"],
        ring_covariance=(found.std, found.covariance),
    )
    return found, damped, scale


SCENARIOS = {
    "exact": {},
    "noise 0.1 %": {"noise": 0.001},
    "noise 0.5 %": {"noise": 0.005},
    "tyres, not rings": {"noise": 1e-4, "wrong": 1.0, "form": 0.005},
    "p0, a wrong": {"noise": 0.001, "wrong": 1.0},
    "default ±": {"noise": 0.001, "wrong": 1.0, "defaults": True},
    "torsion": {"noise": 0.001, "wrong": 1.0, "torsion": True},
    "growth": {"noise": 0.001, "wrong": 1.0, "growth": True},
    "breathing": {"noise": 0.001, "wrong": 1.0, "orders": np.arange(9)},
    "order 1 wrong": {"noise": 0.001, "wrong": 1.0, "order_1": 0.025},
    "p0, a wrong, follower": {"noise": 0.001, "wrong": 1.0, "load": "follower"},
    "4 orders": {"noise": 0.001, "orders": np.arange(1, 5)},
    "5 orders": {"noise": 0.001, "orders": np.arange(1, 6)},
    "masses, width": {"noise": 0.001, "wrong": 1.0, "masses": "width"},
    "masses, no width": {"noise": 0.001, "wrong": 1.0, "masses": "alone"},
    "masses too high": {"noise": 0.001, "masses": "alone", "calibration": 1.0},
    "masses too low": {"noise": 0.001, "masses": "alone", "calibration": -1.0},
}
BASE = {"noise": 0.0, "wrong": 0.0, "form": 0.0, "order_1": 0.0, "masses": ""}
BASE |= {"load": "dead", "orders": ORDERS, "torsion": False, "growth": False}
BASE |= {"defaults": False, "calibration": None}


def coverage(name: str, n_tyres: int) -> None:
    """Print the share of true values within 1.96 standard deviations, and false claims."""
    inside, sizes = defaultdict(list), defaultdict(list)
    claims, states, false, belt = defaultdict(int), defaultdict(int), [], []
    for seed in range(n_tyres):
        rng = np.random.default_rng(seed)
        ring, damping = random_tyre(rng)
        found, damped, scale = tuned(ring, damping, rng, **BASE | SCENARIOS[name])
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
            belt.append((100 * (line / true - 1), 100 * (line / true / scale - 1)))
    print(f"{name}: {dict(states)}, false claims: {', '.join(false) or 'none'}")
    for key, hits in inside.items():
        print(
            f"  {key:32s} {100 * np.mean(hits):5.1f} % of {len(hits)}, "
            f"identified {claims[key]}, median ± {np.median(sizes[key]):.2g} %"
        )
    for what, off in zip(("", ", without calibration error"), np.transpose(belt), strict=False):
        print(
            f"  belt mass{what} off by {np.std(off):.2f} % rms, at most {np.abs(off).max():.2f} %"
        )


def measured(seed: int, orders=ORDERS, *, torsion=False, masses=False, noise=0.001, off=1.0):
    """A random tyre and arguments of `tune_ring` as a test of these orders gives them."""
    rng = np.random.default_rng(seed)
    ring, _ = random_tyre(rng)
    hz = off * model.natural_frequencies_hz(ring, orders)
    hz *= 1 + noise * rng.standard_normal(orders.size)
    known = {
        "frequencies_hz": hz,
        "frequency_std_hz": noise * hz,
        "mean_radius_m": ring.mean_radius_m,
        "inflation_pressure_pa": ring.inflation_pressure_pa,
    }
    if torsion:
        found = model.torsion_frequency_hz(ring) * (1 + noise * rng.standard_normal())
        known |= {"torsion_hz": found, "torsion_std_hz": noise * found}
    if masses:
        mass = model.modal_mass_kg(ring, orders) * (1 + CALIBRATION * rng.standard_normal())
        mass *= 1 + 0.001 * rng.standard_normal(orders.size)
        known |= {"modal_mass_kg": mass, "modal_mass_std_kg": 0.001 * mass}
    return ring, known


def wrong_order(n_tyres: int) -> None:
    """One order 5 % off: how often it is named, and what is called identified beside the truth."""
    for torsion, masses in itertools.product((False, True), repeat=2):
        for order, share in itertools.product(ORDERS, (0.95, 1.05)):
            named, good, false = 0, 0, []
            for seed in range(n_tyres):
                off = np.where(order == ORDERS, share, 1.0)
                ring, known = measured(seed, torsion=torsion, masses=masses, off=off)
                found = model.tune_ring(ORDERS, **known)
                named += any(each.order == order for each in found.verdict.evidence)
                good += found.verdict.is_good
                for key in RING:
                    value = getattr(found.ring, key)
                    wrong = abs(value - getattr(ring, key)) > 0.5 * value
                    if wrong and found.how[key] == "identified":
                        false.append(f"{key} of tyre {seed}")
            print(
                f"torsion {torsion}, masses {masses}, order {order} x {share}: named {named}, "
                f"good {good} of {n_tyres}, false claims: {', '.join(false) or 'none'}"
            )


def shifted_orders(n_tyres: int) -> None:
    """Every order one too low or too high: how often the verdict is bad."""
    for noise, masses, step in itertools.product((1e-4, 1e-3, 5e-3), (False, True), (-1, 1)):
        states, true = defaultdict(int), ORDERS + (step < 0)
        for seed in range(n_tyres):
            _, known = measured(seed, true, masses=masses, noise=noise)
            states[model.tune_ring(true + step, **known).verdict.state.value] += 1
        print(f"noise {noise}, masses {masses}, shift {step:+d}: {dict(states)}")


def band_cut(n_tyres: int) -> None:
    """Four orders instead of eight: whether their 95 % intervals hold the values of eight."""
    inside = defaultdict(list)
    for seed in range(n_tyres):
        _, known = measured(seed)
        many = model.tune_ring(ORDERS, **known)
        few = {key: value[:4] if np.ndim(value) else value for key, value in known.items()}
        few = model.tune_ring(ORDERS[:4], **few)
        for key in set(RING) & set(few.std):
            off = abs(getattr(few.ring, key) - getattr(many.ring, key))
            inside[key].append(off <= 1.96 * few.std[key])
    for key, hits in inside.items():
        print(f"4 orders, {key}: {np.sum(hits)} of {len(hits)} hold the value of 8")


FAULTS = {"wrong order": wrong_order, "shifted orders": shifted_orders, "band cut": band_cut}

if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("scenarios", nargs="*", default=list(SCENARIOS))
    parser.add_argument("--tyres", type=int, default=200)
    chosen = parser.parse_args()
    for each in chosen.scenarios:
        if each in FAULTS:
            FAULTS[each](chosen.tyres)
        else:
            coverage(each, chosen.tyres)
