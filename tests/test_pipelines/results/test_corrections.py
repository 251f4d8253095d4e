"""FRFs of a result folder as measured, and the corrections beside them."""

from dataclasses import fields, replace

import numpy as np
import pandas as pd
import pytest
import pyuff

from ema.checks.corrections import Correction, corrected
from ema.checks.sensor_mass import SensorMass, without_mass
from ema.core.errors import InputError
from pipelines.report.write import save
from pipelines.results.store import load

FLIPPED = Correction(3, "config_4.uff", "A01", 15.0, "flipped", -1.0, 3, False, -0.98, 0.01, 1.2)
DEAD = Correction(72, "config_1.uff", "A13", 0.0, "dead", 1.0, 72, True)

ZERO = np.zeros(6)
DRIFT = {
    "percent": np.linspace(0, 0.3, 6),
    **dict.fromkeys(("std_percent", "slope_percent", "curvature_percent"), ZERO),
    **dict.fromkeys(("damping_percent", "damping_std_percent"), ZERO),
    "applied": True,
}


@pytest.fixture(scope="module")
def result(short_result):
    """The short result as if a sensor had been flipped, another one dead, and all had a mass."""
    frf = short_result.frf.rows(np.append(np.arange(72), 0))
    values = np.array(frf.values)
    values[3] *= -1
    values[72] = 0
    measured = replace(frf, values=values)
    seats = {run: frf.position_deg[np.array(frf.run) == run] for run in frf.run_names}
    warmer = replace(short_result.modal_model.drift, **DRIFT, run=frf.run_names)
    own = {run: 0.001 * np.arange(angles.size) for run, angles in seats.items()}
    modes = np.array([-20.0 + 600.0j]), np.linspace(0.5, 0.1, 33)[None] * (0.01 + 1j)
    mass = SensorMass(0.001, seats, drift=warmer, own_kg=own, mixed=modes)
    changes = (FLIPPED, DEAD)
    fitted = without_mass(corrected(measured, changes), mass)
    return replace(
        short_result, frf=fitted, measured=measured, corrections=changes, sensor_mass=mass
    )


@pytest.fixture
def folder(result, tmp_path):
    save(result, tmp_path / "result", report=False)
    return tmp_path / "result"


def test_files_hold_what_was_measured(result, folder):
    table = pd.read_parquet(folder / "frf.parquet")
    row = table[table["row"] == 3]
    np.testing.assert_array_equal(row["real"] + 1j * row["imag"], result.measured.values[3])
    assert table["row"].nunique() == 73
    sets = pyuff.UFF(str(folder / "frf.uff")).read_sets()
    frfs = [each for each in sets if each["type"] == 58]
    np.testing.assert_allclose(frfs[3]["data"], result.measured.values[3], rtol=1e-6)
    assert len(frfs) == 73


def test_corrections_are_a_table(folder):
    table = pd.read_csv(folder / "corrections.csv")
    assert list(table) == [each.name for each in fields(Correction)]
    assert table["check"].tolist() == ["flipped", "dead"]
    assert table["gain"].iloc[0] == -0.98
    assert table["gain"].isna().tolist() == [False, True]


def test_a_loaded_result_has_the_fitted_frfs_too(result, folder):
    loaded = load(folder)
    assert loaded.corrections == (FLIPPED, DEAD)
    np.testing.assert_array_equal(loaded.measured.values, result.measured.values)
    np.testing.assert_allclose(loaded.frf.values, result.frf.values, rtol=1e-5, atol=1e-9)
    assert loaded.frf.n_positions == loaded.modal_model.position_deg.size == 72
    assert loaded.sensor_mass.mass_kg == 0.001


def test_corrections_of_rows_that_are_not_there_are_refused(result, tmp_path):
    folder = tmp_path / "result"
    save(replace(result, corrections=(FLIPPED, DEAD, DEAD)), folder, report=False)
    with pytest.raises(InputError, match="at most one for each"):
        load(folder)
