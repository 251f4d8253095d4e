"""Where the shapes say that the force acts, and with which sign."""

from dataclasses import replace

import numpy as np
import pytest

from ema.checks.ring_shapes import drive_point_finding
from ema.core.modes import ModalModel, Mode, ResidualTerms

POSITIONS_DEG = np.arange(0.0, 360.0, 5.0)


def model_of(drive_deg: float, *, sign: float = 1.0, orders=(1, 2, 3, 4, 5), split_deg=None):
    """Point masses' worth of a ring driven at one angle; with `split_deg`, pairs so oriented."""
    modes = []
    for order in orders:
        omega = 2 * np.pi * (60 + 25 * order)
        pole = omega * (-0.02 + 1j)
        crests = (drive_deg,) if split_deg is None else (split_deg, split_deg + 90 / order)
        for crest in crests:
            shape = np.cos(order * np.deg2rad(POSITIONS_DEG - crest))
            drive = np.cos(order * np.deg2rad(drive_deg - crest))
            residues = sign * drive * shape / (2j * omega * 8.0)
            modes.append(Mode(pole, 0.01, 1e-4, residues, 1e-9 * np.ones(72), order=order))
    return ModalModel(
        modes=tuple(modes),
        guard_modes=(),
        residual_terms=ResidualTerms(np.zeros(72), np.zeros(72)),
        band_hz=(20.0, 260.0),
        fit_band_hz=(20.0, 260.0),
        covariance=np.zeros((2 * len(modes), 2 * len(modes))),
        frac=np.ones(72),
        misfit=1.0,
        node=np.arange(72),
        position_deg=POSITIONS_DEG,
    )


def only(findings):
    (finding,) = findings
    return finding


@pytest.mark.parametrize("drive_deg", [0.0, 37.0, 250.0])
@pytest.mark.parametrize("split_deg", [None, 11.0])
def test_a_force_at_its_stated_place_is_confirmed(drive_deg, split_deg):
    found = only(drive_point_finding(model_of(drive_deg, split_deg=split_deg), drive_deg))
    assert found.verdict == "ok"


@pytest.mark.parametrize("stated_deg", [4.0, 10.0, 90.0, 180.0, 300.0])
def test_a_force_elsewhere_is_named_with_its_place(stated_deg):
    found = only(drive_point_finding(model_of(0.0), stated_deg))
    assert found.verdict == "warning"
    assert "but from about 0°." in found.detail
    assert found.position_deg == stated_deg


def test_a_reversed_force_is_named():
    found = only(drive_point_finding(model_of(40.0, sign=-1.0), 40.0))
    assert found.verdict == "warning"
    assert "wrong sign" in found.detail


def test_two_orders_are_too_few_to_judge():
    assert drive_point_finding(model_of(0.0, orders=(1, 2)), 90.0) == []


def test_without_angles_or_a_stated_place_nothing_is_said():
    model = model_of(0.0)
    assert drive_point_finding(model, None) == []
    nowhere = replace(model, position_deg=np.full(72, np.nan))
    assert drive_point_finding(nowhere, 0.0) == []
