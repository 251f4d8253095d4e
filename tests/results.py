"""A synthetic result for tests of what shows results: a ring's modes and nothing measured."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ema.checks.quality import ReferenceCheck
from ema.core.campaign import Tyre
from ema.core.finding import Check, Finding, Verdict
from ema.core.frf import FRF
from ema.core.mac import auto_mac
from ema.core.modes import ModalModel, Mode, ResidualTerms
from ema.poles.stability import StabilityDiagram
from ema.poles.tracking import Cluster
from model.damping import identify_damping
from model.tuning import tune_ring
from pipelines.results.result import Result, Validation

ORDERS = np.arange(1, 8)
FREQUENCIES_HZ = np.array([78.73, 100.31, 121.40, 145.45, 170.78, 196.52, 224.40])
DAMPING = np.array([0.0412, 0.0281, 0.0259, 0.0231, 0.0211, 0.0190, 0.0181])
BAND_HZ = (40.0, 250.0)


def provenance(campaign: str) -> dict[str, object]:
    """What ``provenance.json`` of a result holds that later stages need."""
    return {
        "software": {"ringmodal": "0.1.0", "numpy": np.__version__},
        "created": "2025-01-01T00:00:00+00:00",
        "campaign": campaign,
        "inputs": [{"file": "config_1.uff", "bytes": 1, "sha256": "0123456789abcdef" * 4}],
        "options": {
            "tune": True,
            "objective": "frequency",
            "given": {},
            "processing": {"averages": 10, "window": "boxcar", "band_hz": list(BAND_HZ)},
        },
        "stage_seconds": {"read": 0.1, "modes": 0.4},
    }


def tyre_result(seed: int = 1, **changes: object) -> Result:
    """A result of seven orders at 72 positions in six runs, with every stage present."""
    modal_model = ring_modes(np.arange(72) * 5.0)
    frf = noisy_frf(modal_model, seed)
    tuning = tune_ring(ORDERS, FREQUENCIES_HZ, mean_radius_m=0.33, inflation_pressure_pa=2.2e5)
    damping = identify_damping(tuning.ring, ORDERS, DAMPING)
    parts: dict[str, object] = {
        "name": "synthetic",
        "tyre": Tyre("225/55R17", 2.2e5, 0.33, 0.19, {"serial": "none, synthetic"}),
        "frf": frf,
        "measured": frf,
        "diagram": diagram(modal_model),
        "modal_model": modal_model,
        "reference": reference(modal_model, seed),
        "tuning": tuning,
        "damping": damping,
        "validation": Validation(
            ORDERS,
            FREQUENCIES_HZ,
            tuning.model_hz,
            DAMPING,
            damping.model,
            np.eye(7) * 0.98 + 0.01,
            auto_mac(np.stack([mode.residues for mode in modal_model.modes])),
        ),
        "excitation_deg": 0.0,
        "reference_deg": 2.5,
        "findings": findings(),
        "notes": ("Sensor mass was not given: frequencies are those of the tyre with sensors.",),
        "provenance": provenance("tyre_7"),
    }
    return Result(**(parts | changes))  # type: ignore[arg-type]


def structure_result(seed: int = 1, **changes: object) -> Result:
    """A result of a structure with ten nodes: no circle, no coherence, no ring."""
    modal_model = ring_modes(np.linspace(0, 130, 10))
    blank = np.full(10, np.nan)
    node = np.arange(1, 11)
    modes = tuple(
        Mode(m.pole, m.frequency_std_hz, m.damping_std, m.residues, m.residues_std)
        for m in modal_model.modes
    )
    modal_model = ModalModel(
        modes,
        (),
        modal_model.residual_terms,
        BAND_HZ,
        BAND_HZ,
        modal_model.covariance,
        modal_model.frac,
        float("nan"),
        node,
        blank,
    )
    frf = noisy_frf(modal_model, seed)
    unknown = np.full(frf.values.shape, np.nan)
    frf = FRF(frf.frequency_hz, frf.values, unknown, unknown, node, blank, ("",) * 10)
    why = "There is no grid and no tyre: orders and ring parameters were not sought."
    parts: dict[str, object] = {
        "name": "plate",
        "tyre": None,
        "frf": frf,
        "measured": frf,
        "diagram": diagram(modal_model),
        "modal_model": modal_model,
        "reference": None,
        "tuning": None,
        "damping": None,
        "validation": None,
        "excitation_deg": None,
        "reference_deg": None,
        "notes": (why,),
        "provenance": provenance("plate"),
    }
    return Result(**(parts | changes))  # type: ignore[arg-type]


def ring_modes(position_deg: np.ndarray) -> ModalModel:
    """Seven standing waves around a circle, driven at 0°."""
    count = position_deg.size
    modes = tuple(
        Mode(
            pole=2 * np.pi * f * complex(-zeta, np.sqrt(1 - zeta**2)),
            frequency_std_hz=0.0002 * f,
            damping_std=0.01 * zeta,
            residues=np.cos(order * np.deg2rad(position_deg)) / (2j * 2 * np.pi * f * 4.0),
            residues_std=np.full(count, 1e-6),
            order=int(order),
            order_purity=0.998,
        )
        for order, f, zeta in zip(ORDERS, FREQUENCIES_HZ, DAMPING, strict=True)
    )
    ones = np.ones(count)
    return ModalModel(
        modes,
        (),
        ResidualTerms(0.01 * ones, 1e-8 * ones),
        BAND_HZ,
        (30.0, 260.0),
        np.zeros((14, 14)),
        1 - 0.02 * np.abs(np.sin(np.deg2rad(7 * position_deg))),
        1.3,
        np.arange(count),
        position_deg,
    )


def noisy_frf(model: ModalModel, seed: int) -> FRF:
    """The model's inertances with 1 % of their peak as noise."""
    frequency_hz = np.arange(0.0, 300.0, 0.25)
    exact = model.synthesise(frequency_hz)
    random = np.random.default_rng(seed)
    std = 0.01 * np.abs(exact).max()
    noise = random.normal(size=(2, *exact.shape)) * std
    values = exact + noise[0] + 1j * noise[1]
    coherence = np.abs(exact) ** 2 / (np.abs(exact) ** 2 + 2 * std**2)
    runs = tuple(f"config_{row % 6 + 1}.uff" for row in range(exact.shape[0]))
    return FRF(
        frequency_hz,
        values,
        coherence,
        np.full(exact.shape, std),
        model.node,
        model.position_deg,
        runs,
    )


def diagram(model: ModalModel) -> StabilityDiagram:
    """Poles that settle with the model order, and a column that does not count."""
    truth = np.array([mode.pole for mode in model.modes])
    orders = np.arange(10, 61, 2)
    random = np.random.default_rng(7)
    poles, model_order, labels = [], [], []
    for order in orders:
        scatter = random.normal(size=truth.size) * 0.05 / order
        stray = 2 * np.pi * random.uniform(45, 245, order // 6) * (1j - 0.05)
        extra = 2 * np.pi * 187.0 * (1j - 0.001)
        poles.append(np.concatenate([truth * (1 + scatter), [extra], stray]))
        labels.append([*range(truth.size), truth.size, *[-1] * stray.size])
        model_order.append(np.full(truth.size + 1 + stray.size, order))
    label = np.concatenate(labels)
    clusters = [
        Cluster(index, pole, orders.size, True, "present in every model order")
        for index, pole in enumerate(truth)
    ]
    clusters.append(
        Cluster(truth.size, 2 * np.pi * 187.0 * (1j - 0.001), 26, False, "shape not repeatable")
    )
    frequency_hz = np.arange(30.0, 260.0, 0.25)
    indicator = np.sqrt(np.mean(np.abs(model.synthesise(frequency_hz)) ** 2, axis=0))
    return StabilityDiagram(
        BAND_HZ,
        np.concatenate(model_order),
        np.concatenate(poles),
        label >= 0,
        label >= 0,
        label,
        tuple(clusters),
        frequency_hz,
        indicator,
    )


def without_poles(diagram: StabilityDiagram) -> StabilityDiagram:
    """A stability diagram in which nothing was found."""
    none = np.zeros(0)
    return replace(
        diagram,
        model_order=none,
        poles=none,
        stable_frequency=none,
        stable_damping=none,
        cluster=none,
        clusters=(),
    )


def reference(model: ModalModel, seed: int) -> ReferenceCheck:
    """Six repetitions of one inertance, apart by noise alone."""
    frequency_hz = np.arange(30.0, 260.0, 0.25)
    exact = model.synthesise(frequency_hz)[0]
    random = np.random.default_rng(seed)
    std = 0.01 * np.abs(exact).max()
    noise = random.normal(size=(2, 6, exact.size)) * std
    runs = tuple(f"config_{run}.uff" for run in range(1, 7))
    values = exact + noise[0] + 1j * noise[1]
    return ReferenceCheck(runs, frequency_hz, values, np.full(values.shape, std), 1.02, std, True)


def findings() -> tuple[Finding, ...]:
    """A passed check and a warning."""
    return (
        Finding("config_1.uff", "A01", 0.0, Check.COHERENCE, Verdict.OK, "median 0.99"),
        Finding(
            "config_3.uff",
            "A05",
            130.0,
            Check.HUM,
            Verdict.WARNING,
            "50 Hz line 12 dB above its sides",
        ),
    )
