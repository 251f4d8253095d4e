"""Parameters over pressure: lines with known answers, what counts as a point, the files."""

import numpy as np
import pytest
from library import DESIGNATION, SET, varied, written

from ema.core.errors import InputError
from pipelines.library.history import fit_line, pressure_series
from pipelines.library.library import TyreLibrary
from pipelines.plots.draw import draw_plot
from pipelines.plots.ring import pressure_plot
from pipelines.report.ring import write_series

PRESSURES_PA = (1.8e5, 2.2e5, 2.6e5)


@pytest.fixture
def library(tmp_path):
    return TyreLibrary(tmp_path / "library")


@pytest.fixture
def series_of(library, tmp_path):
    """Versions of one tyre from parameter sets."""

    def versions(*sets):
        for parameters in sets:
            library.add(written(tmp_path / "set.toml", parameters), author="Ada")
        return library.tyre(DESIGNATION).intact_versions()

    return versions


def at_pressures(*pressures_pa, slope=20.0):
    """Sets whose radial stiffness lies on a straight line."""
    return [
        varied(str(pressure), pressure, radial_stiffness_n_m3=8e6 + slope * (pressure - 2.2e5))
        for pressure in pressures_pa
    ]


def test_an_exact_line_is_found_with_the_errors_of_its_points():
    x, std = np.array([1.0, 2.0, 4.0]), np.array([0.1, 0.2, 0.1])
    line = fit_line(x, 3 + 2 * x, std)
    assert line.slope == pytest.approx(2)
    assert line.at(0.0) == pytest.approx(3)
    assert line.scatter == pytest.approx(0, abs=1e-12)
    design = np.stack([np.ones(3), x], axis=1)
    covariance = np.linalg.inv(design.T @ np.diag(std**-2) @ design)
    assert line.slope_std == pytest.approx(covariance[1, 1] ** 0.5)
    assert line.std_at(0.0) == pytest.approx(covariance[0, 0] ** 0.5)


def test_points_that_scatter_more_than_their_errors_raise_them():
    x, std = np.arange(4.0), np.full(4, 0.1)
    y = x + np.array([1, -1, -1, 1])
    line = fit_line(x, y, std)
    assert line.scatter == pytest.approx((4 / 0.1**2 / 2) ** 0.5)
    assert line.slope_std == pytest.approx(line.scatter * 0.1 / 5**0.5)


def test_without_std_it_follows_from_the_scatter_of_three_points_or_more():
    x, unknown = np.arange(4.0), np.full(4, np.nan)
    y = x + np.array([1, -1, -1, 1])
    line = fit_line(x, y, unknown)
    assert line.slope_std == pytest.approx((4 / 2) ** 0.5 / 5**0.5)
    assert np.isnan(line.scatter)
    assert np.isnan(fit_line(x[:2], y[:2], unknown[:2]).slope_std)
    same = fit_line(x, np.full(x.size, 7.1), unknown)
    assert (same.value, same.slope) == (7.1, 0.0)
    assert np.isnan([same.value_std, same.slope_std, same.scatter]).all()


def test_the_slope_of_a_tyre_is_found_per_pascal(series_of):
    found = pressure_series(series_of(*at_pressures(*PRESSURES_PA)))
    trends = {trend.name: trend for trend in found.trends}
    assert trends["radial_stiffness_n_m3"].line.slope == pytest.approx(20.0)
    assert trends["loss_factor"].line.slope == pytest.approx(0, abs=1e-15)
    assert trends["radial_stiffness_n_m3"].version == (1, 2, 3)
    assert "mean_radius_m" not in trends
    assert "Not identified at two pressures: axial_stiffness_n_m." in found.notes


def test_of_the_same_recordings_the_newest_version_counts(series_of):
    first, second = at_pressures(1.8e5, 2.6e5)
    found = pressure_series(series_of(first, second, first))
    assert {trend.version for trend in found.trends} == {(3, 2)}
    assert found.notes[0].startswith("Left out: version 1,")


def test_other_changing_conditions_are_noted(library, tmp_path):
    for temperature_c, parameters in enumerate(at_pressures(1.8e5, 2.6e5)):
        path = written(tmp_path / "set.toml", parameters)
        library.add(path, author="Ada", conditions={"temperature_c": float(temperature_c)})
    found = pressure_series(library.tyre(DESIGNATION).intact_versions())
    assert "Besides the pressure, temperature_c changes from version to version." in found.notes


def test_one_pressure_makes_no_series(series_of):
    with pytest.raises(InputError, match=r"recordings at 2\.2 bar.*two different pressures"):
        pressure_series(series_of(SET, varied("2")))


def test_a_parameter_that_was_never_identified_is_named(series_of):
    versions = series_of(*at_pressures(*PRESSURES_PA))
    with pytest.raises(InputError, match="needs axial_stiffness_n_m identified"):
        pressure_series(versions, ["axial_stiffness_n_m"])


def test_an_unknown_parameter_gets_the_nearest_one(series_of):
    versions = series_of(*at_pressures(*PRESSURES_PA))
    with pytest.raises(InputError, match="Did you mean 'radial_stiffness_n_m3'"):
        pressure_series(versions, ["radial_stiffness"])


@pytest.mark.parametrize(("unit", "middle"), [("bar", 2.2), ("kPa", 220.0), ("psi", 31.9)])
def test_the_plot_shows_each_parameter_in_the_chosen_unit(series_of, unit, middle):
    found = pressure_series(series_of(*at_pressures(*PRESSURES_PA)))
    axes = [ax for ax in draw_plot(pressure_plot(found, unit)).axes if ax.axison]
    assert len(axes) == len(found.trends)
    (radial,) = (ax for ax in axes if ax.get_title(loc="left") == "radial stiffness")
    assert radial.get_xlabel() == f"inflation pressure / {unit}"
    assert np.mean(radial.get_xlim()) == pytest.approx(middle, rel=1e-2)
    assert np.mean(radial.lines[0].get_ydata()) == pytest.approx(8.0)  # in 10⁶ N/m³


@pytest.mark.parametrize(
    ("name", "begins"), [("s.png", b"\x89PNG"), ("s.svg", b"<?xml"), ("s.html", b"<!doctype html>")]
)
def test_the_ending_decides_the_format(series_of, tmp_path, name, begins):
    found = pressure_series(series_of(*at_pressures(*PRESSURES_PA)), ["radial_stiffness_n_m3"])
    write_series(tmp_path / name, found, "bar")
    content = (tmp_path / name).read_bytes()
    assert content[:20].lower().startswith(begins.lower())
    if name.endswith("html"):
        assert "slope per bar" in content.decode()
