"""Functions that Testlab exports to MATLAB."""

import numpy as np
import pytest
import scipy.io

from ema.core.errors import RecordingFormatError
from ema.io.formats import read_file


def function_of_testlab(name, unit, samples, **axis):
    """A function as Testlab exports it."""
    stated = {"start_value": 0.0, "increment": 1 / 512, "number_of_values": float(len(samples))}
    return {
        "x_values": {**stated, "quantity": {"label": "s"}, **axis},
        "y_values": {"values": np.asarray(samples)[:, None], "quantity": {"label": unit}},
        "function_record": {"name": name, "type": "Signal"},
    }


_FORCE, _MOTION = np.random.default_rng(8).standard_normal((2, 64))


def _functions(path, **axis):
    variables = {
        "Signal_0": function_of_testlab("Tire:13:-Z", "g", _MOTION, **axis),
        "Signal_1": function_of_testlab("Hub:1:+Z", "N", _FORCE),
    }
    scipy.io.savemat(path, variables)
    return path


def test_functions_of_testlab(tmp_path):
    found = read_file(_functions(tmp_path / "a.mat")).recording
    assert found.names == ("Tire:13:-Z", "Hub:1:+Z")
    assert found.sampling_rate_hz == 512.0
    assert [each.node for each in found.channels] == [13, 1]
    np.testing.assert_allclose(found.block(0, 64), [-9.80665 * _MOTION, _FORCE], rtol=1e-12)


@pytest.mark.parametrize(
    ("axis", "message"),
    [
        ({"increment": 1 / 1024}, "512"),
        ({"quantity": {"label": "Hz"}}, "complex FRFs"),
        ({"quantity": {"label": "m"}}, "over time"),
        ({"start_value": 0.5 / 512}, "whole samples apart"),
        ({"increment": "fast"}, "one number"),
    ],
)
def test_functions_of_testlab_that_are_refused(tmp_path, axis, message):
    with pytest.raises(RecordingFormatError, match=message):
        read_file(_functions(tmp_path / "a.mat", **axis))


def test_frfs_of_testlab(tmp_path):
    axis = {"quantity": {"label": "Hz"}, "start_value": 0.5, "increment": 0.5}
    values, share = _MOTION + 1j * _FORCE, np.linspace(0, 1, 64)
    variables = {
        "COH_0": function_of_testlab("Coherence Tire:13:-Z/Tire:1:+Z", "/", share, **axis),
        "FRF_0": function_of_testlab("FRF Tire:14:+Z/Tire:1:+Z", "g/N", 2 * values, **axis),
        "FRF_1": function_of_testlab("FRF Tire:13:-Z/Tire:1:+Z", "g/N", values, **axis),
        "PSD_0": function_of_testlab("PSD Tire:1:+Z", "N^2/Hz", share, **axis),
    }
    scipy.io.savemat(tmp_path / "a.mat", variables)
    found = read_file(tmp_path / "a.mat")
    np.testing.assert_allclose(found.frf.frequency_hz, 0.5 * np.arange(1, 65))
    assert (found.frf.node.tolist(), found.frf_force_node) == ([14, 13], 1)
    np.testing.assert_allclose(found.frf.values, 9.80665 * np.array([2 * values, -values]))
    np.testing.assert_array_equal(found.frf.coherence, [np.full(64, np.nan), share])
    assert [each.channel for each in found.findings] == ["PSD_0"]
    variables["FRF_1"]["x_values"]["increment"] = 1.0
    scipy.io.savemat(tmp_path / "a.mat", variables)
    with pytest.raises(RecordingFormatError, match="same frequency lines"):
        read_file(tmp_path / "a.mat")


def test_a_coherence_of_several_forces_is_left_out(tmp_path):
    axis = {"quantity": {"label": "Hz"}, "start_value": 0.5, "increment": 0.5}
    variables = {
        "COH": function_of_testlab("Multiple Coherence Tire:13:+Z", "/", _FORCE**2, **axis),
        "FRF_0": function_of_testlab("FRF Tire:13:+Z/Tire:1:+Z", "g/N", _MOTION + 1j, **axis),
        "FRF_1": function_of_testlab("FRF Tire:14:+Z/Tire:1:+Z", "g/N", _MOTION + 2j, **axis),
    }
    scipy.io.savemat(tmp_path / "a.mat", variables)
    found = read_file(tmp_path / "a.mat")
    assert np.isnan(found.frf.coherence).all()
    assert [each.channel for each in found.findings] == ["COH"]
