"""What other Python packages get is what they expect, and comes back as it was."""

import sys
from pathlib import Path

import numpy as np
import pytest
from results import ring_modes, structure_result, tyre_result

from ema.core.errors import InputError
from ema.core.recording import Channel, Recording
from ema.core.units import STANDARD_GRAVITY_M_S2
from ema.io.interchange import from_sep005, poles_and_shapes_for_sdypy, to_sep005
from ema.io.uff.reader import read as read_uff

FRF = tyre_result().frf


def recording(rate_hz=2000.0):
    noise = np.random.default_rng(5).normal(size=(3, 64))
    channels = (
        Channel("force", "force", "N", noise[0]),
        Channel("A01", "acceleration", "g", noise[1], STANDARD_GRAVITY_M_S2, node=12),
        Channel("strain", "unknown", "um/m", noise[2]),
    )
    return Recording(Path("config_1.uff"), rate_hz, channels)


def series(**changes):
    return {"name": "A01", "data": [0.0, 1.0, None], "fs": 100.0, "unit_str": "g"} | changes


def test_time_series_follow_sep_005():
    checks = pytest.importorskip("sdypy_sep005.sep005")
    found = to_sep005(recording())
    checks.assert_sep005(found)
    assert [each["unit_str"] for each in found] == ["N", "m/s²", "um/m"]
    assert [each.get("quantity") for each in found] == ["f", "a", None]
    assert [each.get("node") for each in found] == [None, 12, None]
    assert {each["fs"] for each in found} == {2000.0}


def test_time_series_return_as_they_were(sample_campaign):
    for original in (recording(), read_uff(sample_campaign / "config_1.uff").recording):
        again = from_sep005(to_sep005(original))
        assert again.names == original.names
        assert again.sampling_rate_hz == original.sampling_rate_hz
        for one, other in zip(original.channels, again.channels, strict=True):
            assert (one.quantity, one.node) == (other.quantity, other.node)
            np.testing.assert_array_equal(one.block(0, 50), other.block(0, 50))


def test_units_and_times_of_others_are_understood():
    told = series(data=[1.0, 2.0, None], fs=None, time=[0.0, 0.5, 1.0], quantity="a")
    found = from_sep005([told])
    assert found.sampling_rate_hz == 2.0
    np.testing.assert_allclose(found.block(0, 3)[0], [9.80665, 19.6133, np.nan])
    assert from_sep005([series(unit_str="bar")]).channels[0].quantity == "unknown"


@pytest.mark.parametrize(
    ("told", "says"),
    [
        ([], "no channels"),
        ([series(name=None)], "no name"),
        ([series(unit_str=None)], "no unit_str"),
        ([series(fs=None)], "fs None"),
        ([series(fs=-1.0)], "fs -1"),
        ([series(fs=None, time=[0.0, 1.0, 5.0])], "row 2 of 3"),
        ([series(data=["a", "b"])], "could not convert"),
        ([series(data=[[1.0, 2.0]])], "shape \\(1, 2\\)"),
        ([series(quantity="f")], "contradict"),
        ([series(), series(fs=50.0)], "rates 50, 100 Hz"),
        ([series(), series(data=[1.0])], "lengths 1, 3"),
    ],
)
def test_what_is_no_recording_is_refused(told, says):
    with pytest.raises(InputError, match=says):
        from_sep005(told)


def test_a_recording_without_rate_is_refused():
    with pytest.raises(InputError, match="no sampling rate"):
        to_sep005(recording(float("nan")))


def test_long_frame_has_a_row_for_each_value():
    frame = FRF.to_frame()
    assert len(frame) == FRF.values.size
    row = frame[(frame["position_deg"] == 35.0) & (frame["frequency_hz"] == 100.0)].iloc[0]
    at = 7, int(np.flatnonzero(FRF.frequency_hz == 100.0)[0])
    assert row["inertance"] == FRF.values[at]
    assert (row["std"], row["coherence"]) == (FRF.std[at], FRF.coherence[at])
    assert (row["node"], row["run"]) == (FRF.node[7], FRF.run[7])


@pytest.mark.parametrize(
    ("frf", "name", "column"),
    [(FRF, "position_deg", 35.0), (structure_result().frf, "node", 8)],
    ids=["circle", "structure"],
)
def test_wide_frame_has_a_column_for_each_place(frf, name, column):
    frame = frf.to_frame("wide")
    assert (frame.index.name, frame.columns.name) == ("frequency_hz", name)
    np.testing.assert_array_equal(frame[column], frf.values[7])


def test_no_other_frame():
    with pytest.raises(InputError, match="'long' or 'wide'"):
        FRF.to_frame("tall")


def test_xarray_keeps_values_places_and_units():
    pytest.importorskip("xarray")
    found = FRF.to_xarray()
    assert found["inertance"].dims == ("position", "frequency_hz")
    assert found["inertance"].attrs["units"] == "(m/s^2)/N"
    np.testing.assert_array_equal(found["inertance"], FRF.values)
    np.testing.assert_array_equal(found["coherence"], FRF.coherence)
    one = found.isel(position=7).sel(frequency_hz=100.0)
    assert float(one["position_deg"]) == 35.0


def test_without_xarray_the_message_says_how_to_get_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(InputError, match="pip install xarray"):
        FRF.to_xarray()


def test_sdypy_draws_the_same_frfs_from_our_poles():
    """Its least squares, given our poles and exact FRFs, ends at our modal constants."""
    ema_package = pytest.importorskip("sdypy.EMA")
    model = ring_modes(np.arange(12) * 30.0)
    lines_hz = np.arange(20.0, 280.0, 0.25)
    exact = model.synthesise(lines_hz)
    target = ema_package.Model(exact, lines_hz, lower=40, upper=260, frf_form="accelerance")
    modes = poles_and_shapes_for_sdypy(model)
    modes.put_into(target)
    np.testing.assert_array_equal(target.A[:, 2], model.modes[2].residues)
    drawn, constants = target.get_constants(f_upper=255.0)
    scale = np.abs(modes.A).max()
    np.testing.assert_allclose(constants, modes.A, rtol=0, atol=1e-6 * scale)
    band = slice(*np.searchsorted(lines_hz, [45.0, 255.0]))
    np.testing.assert_allclose(drawn[:, band], exact[:, band], rtol=0, atol=1e-6)
    np.testing.assert_allclose(target.nat_freq, model.frequencies_hz)
