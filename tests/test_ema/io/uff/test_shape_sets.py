"""Mode shapes of datasets 55 and 2414: what is stored is what is read."""

import numpy as np
import pytest
from builders import SHARED_DATA, dataset, nodes2411, response58
from hypothesis import given, settings
from hypothesis import strategies as st
from uff_datasets import COMPLEX, COMPLEX_VALUES, REAL, SIX, shape55, shape2414

import ema
from ema.core.errors import RecordingFormatError
from ema.io.uff.shape_sets import read_shapes

CORPUS = SHARED_DATA / "uff_corpus"


def read(tmp_path, content):
    (path := tmp_path / "a.uff").write_bytes(content)
    return read_shapes(path)


@pytest.mark.parametrize("build", [shape55, shape2414])
def test_normal_mode(tmp_path, build):
    found = read(tmp_path, build())
    assert found.frequency_hz.tolist() == [80.0]
    assert found.damping_ratio.tolist() == [0.03]
    assert found.node.tolist() == [1, 1, 1, 2, 2, 2]
    assert found.direction.tolist() == [1, 2, 3, 1, 2, 3]
    np.testing.assert_array_equal(found.values, [[1.0, -2.0, 0.5, 0.0, 0.25, -1e-3]])
    assert np.isnan(found.angle_deg).all()
    assert found.findings == ()
    assert ema.read_shapes is read_shapes


@pytest.mark.parametrize("analysis", [3, 7])
@pytest.mark.parametrize("build", [shape55, shape2414])
def test_complex_mode(tmp_path, build, analysis):
    pole = -0.6 + 0.8j  # ω = 1 rad/s, ζ = 0.6
    reals = (pole.real, pole.imag, 1.0, 0.0, 1.0, 0.0)
    if build is shape2414:
        reals = (0.0,) * 6 + reals
    shape = {5: [1 + 2j, -3.5j, 0.25 + 0j]}
    found = read(tmp_path, build(shape, analysis=analysis, kind=COMPLEX_VALUES, reals=reals))
    assert found.frequency_hz == pytest.approx([1 / (2 * np.pi)], rel=1e-12)
    assert found.damping_ratio == pytest.approx([0.6], rel=1e-12)
    np.testing.assert_array_equal(found.values, [[1 + 2j, -3.5j, 0.25]])


@pytest.mark.parametrize("build", [shape55, shape2414])
@pytest.mark.parametrize("kind", [REAL, COMPLEX_VALUES])
def test_six_degrees_of_freedom(tmp_path, build, kind):
    numbers = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    if kind == COMPLEX_VALUES:
        numbers = [complex(each, -each) for each in numbers]  # twelve numbers take two lines
    found = read(tmp_path, build({9: numbers}, characteristic=SIX, n=6, kind=kind))
    assert found.direction.tolist() == [1, 2, 3, 4, 5, 6]
    np.testing.assert_array_equal(found.values, [numbers])


@pytest.mark.parametrize(
    ("viscous", "hysteretic", "expected"), [(0.03, 0.2, 0.03), (0.0, 0.06, 0.03), (0, 0, np.nan)]
)
def test_damping_of_normal_modes(tmp_path, viscous, hysteretic, expected):
    by_55 = read(tmp_path, shape55(reals=(80.0, 1.0, viscous, hysteretic)))
    by_2414 = read(tmp_path, shape2414(reals=(0.0, 80.0, 0.0, 1.0, viscous, hysteretic)))
    np.testing.assert_array_equal(by_55.damping_ratio, [expected])
    np.testing.assert_array_equal(by_2414.damping_ratio, [expected])


def test_a_rigid_body_mode_has_no_damping_ratio(tmp_path):
    found = read(tmp_path, shape55(analysis=COMPLEX, reals=(0.0,) * 6))
    assert found.frequency_hz.tolist() == [0.0]
    assert np.isnan(found.damping_ratio).all()


@pytest.mark.parametrize(("build", "absent"), [(shape55, 0.0), (shape2414, np.nan)])
def test_nodes_that_are_not_listed(tmp_path, build, absent):
    found = read(tmp_path, build({1: [1.0, 2.0, 3.0]}) + build({2: [4.0, 5.0, 6.0]}))
    expected = [[1, 2, 3, absent, absent, absent], [absent, absent, absent, 4, 5, 6]]
    np.testing.assert_array_equal(found.values.real, expected)


def test_modes_of_three_and_six_directions(tmp_path):
    six = shape2414({1: [1.0] * 6}, characteristic=SIX, n=6)
    found = read(tmp_path, six + shape2414({1: [2.0] * 3}))
    np.testing.assert_array_equal(found.values.real[1], [2, 2, 2, np.nan, np.nan, np.nan])


def test_angles_from_the_geometry(tmp_path):
    points = {k: (np.cos(k * np.pi / 6), np.sin(k * np.pi / 6), 0.0) for k in range(12)}
    shape = {k: [float(k), 0.0, 0.0] for k in range(12)}
    found = read(tmp_path, shape2414(shape) + nodes2411(points))
    assert found.angle_deg == pytest.approx(np.repeat(np.arange(0.0, 360.0, 30.0), 3), abs=1e-9)


@pytest.mark.parametrize(
    ("other", "named"),
    [
        (shape55(analysis=1), "static"),
        (shape55(analysis=5, reals=(80.0,)), "frequency response"),
        (shape2414(analysis=4), "transient"),
        (shape2414(analysis=8), "of a 8 analysis"),
        (shape2414(location=2), "values of elements"),
        (shape55({1: [1.0] * 6}, characteristic=4, n=6, result=2), "no motion"),
        (shape55({1: [1.0] * 2}, n=2), "2 values per node"),
        (shape55(result=5), "results of type 5"),
        (shape2414(kind=1), "values of kind 1"),
    ],
)
def test_what_is_no_mode_is_named_and_left_out(tmp_path, other, named):
    found = read(tmp_path, shape55() + other)
    assert found.n_modes == 1
    assert named in found.findings[0].detail
    assert found.findings[0].detail.startswith("dataset 2 (")
    with pytest.raises(RecordingFormatError, match=named):
        read(tmp_path, other)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (response58(), "none of them 55 or 2414"),
        (shape55({}), "mode shapes are"),
        (shape55({1: [1.0, 2.0]}), "end of the dataset"),
        (shape55({1: [1.0, 2.0, 3.0, 4.0]}), "4 numbers; node 1 has 3"),
        (shape55()[:-7] + b"         1\n  0.0 0.0 0.0\n    -1\n", "node 1 twice"),
        (shape55(reals=(-80.0, 1.0, 0.0, 0.0)), "positive and finite"),
        (shape55(reals=(np.nan, 1.0, 0.0, 0.0)), "positive and finite"),
        (shape55(analysis=COMPLEX, reals=(np.inf, np.nan, 0, 0, 0, 0)), "positive and finite"),
        (dataset(55, *["NONE"] * 5), "end of the dataset"),
        (dataset(55, *["NONE"] * 5, "1 2 2 8"), "4 numbers; .* 6"),
        (dataset(2414, "what", "x", "y"), "columns 1 to 10"),
        (b"".join(shape2414({k: [1.0] * 3}) for k in range(1, 30)), "share their nodes"),
        (shape55()[:-7], "truncated"),
    ],
)
def test_damage_is_named(tmp_path, content, message):
    with pytest.raises(RecordingFormatError, match=message) as caught:
        read(tmp_path, content)
    assert "a.uff" in caught.value.where


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(RecordingFormatError, match="No such file"):
        read_shapes(tmp_path / "none.uff")


@settings(max_examples=200)
@given(st.data())
def test_any_damaged_byte_is_read_or_refused(tmp_path_factory, data):
    content = bytearray(data.draw(st.sampled_from([shape55(), shape2414()])))
    for _ in range(data.draw(st.integers(1, 4))):
        where = data.draw(st.integers(0, len(content) - 1))
        content[where] = data.draw(st.integers(0, 255))
    try:
        found = read(tmp_path_factory.mktemp("any"), bytes(content))
    except RecordingFormatError as error:
        assert error.remedy
    else:
        assert found.values.shape == (found.n_modes, len(found.node))


@pytest.mark.skipif(not CORPUS.exists(), reason="measured data of others are not at hand")
@pytest.mark.parametrize(
    ("name", "n_modes", "n_rows", "frequencies"),
    [
        ("uff55_translation.uff", 3, 12, [10.0, 12.0, 13.0]),
        ("uff55_translation_rotation.uff", 1, 258, [97.013]),
        ("2411 and 2414.uff", 10, 2646, [0.956363, 2.34163]),
        ("NX simulation output.uff", 176, 54, [23383.2, 23384.1]),
    ],
)
def test_real_shapes(name, n_modes, n_rows, frequencies):
    found = read_shapes(CORPUS / name)
    assert found.values.shape == (n_modes, n_rows)
    assert np.isfinite(found.values).all()
    assert found.frequency_hz[: len(frequencies)].tolist() == frequencies


@pytest.mark.skipif(not CORPUS.exists(), reason="measured data of others are not at hand")
def test_real_results_of_no_modal_analysis_are_named():
    with pytest.raises(RecordingFormatError, match=r"dataset 5 \(2414\): results of a static"):
        read_shapes(CORPUS / "heat_engine_housing.uff")
