"""Universal files that other programs wrote: each is read, or said to hold nothing of use."""

import numpy as np
import pytest
import pyuff
from builders import SHARED_DATA

from ema.core.errors import RecordingFormatError
from ema.io.uff.reader import read as read_uff

CORPUS = SHARED_DATA / "uff_corpus"
REAL = SHARED_DATA / "real"
pytestmark = pytest.mark.skipif(not CORPUS.exists(), reason="files of others are not at hand")

# channels, samples of each, sampling rate, quantity
RECORDINGS = {
    "MPSTD#Set001_2024_10_08_10_27_07.uff": (4, 222_400, 3200.0, "acceleration"),
    "Sample_UFF58_ascii.uff": (1, 79_292, 65_536.0, "unknown"),
    "Sample_UFF58b_bin.uff": (1, 79_292, 65_536.0, "unknown"),
}
NOTHING = {
    "1858.uff": "dataset 1858 (qualifiers of functions): ",
    "2411 and 2414.uff": "mode shapes are read by ema.read_shapes",
    "Artemis export - Geometry RPBC_setup_05_14102016_105117.uff": "15 (nodes), dataset 82 (trace",
    "NX simulation output.uff": "dataset 2420 (coordinate systems), dataset 2411 (nodes)",
    "heat_engine_housing.uff": "dataset 2412 (elements): ",
    "mesh_Oros-modal_uff15_uff2412.uff": "dataset 18 (coordinate systems), dataset 15 (nodes)",
    "sample_dataset58_psd.uff": "function type 9 (power spectral density): ",
    "uff55_translation.uff": "dataset 55 (data at nodes): left out; mode shapes are read by",
    "uff55_translation_rotation.uff": "dataset 55 (data at nodes): left out; mode shapes",
}
CUT_SHORT = "dataset_milestone_in_header.uff"


def test_every_file_has_its_expectation():
    expected = {*RECORDINGS, *NOTHING, CUT_SHORT}
    assert {path.name for path in CORPUS.glob("*.uff")} == expected


@pytest.mark.parametrize("name", RECORDINGS)
def test_recordings(name):
    n_channels, n_samples, rate, quantity = RECORDINGS[name]
    found = read_uff(CORPUS / name)
    assert len(found.recording.channels) == n_channels
    assert found.recording.n_samples == n_samples
    assert found.recording.sampling_rate_hz == rate
    assert {each.quantity for each in found.recording.channels} == {quantity}
    assert found.findings == ()


@pytest.mark.parametrize("name", NOTHING)
def test_files_that_hold_no_recording_say_what_they_hold(name):
    found = read_uff(CORPUS / name)
    assert found.recording is None
    assert found.frf is None
    (finding,) = found.findings
    assert NOTHING[name] in finding.detail


def test_a_file_cut_short_says_how_much_is_there():
    with pytest.raises(RecordingFormatError, match="42 of 2508876 values; the file is truncated"):
        read_uff(CORPUS / CUT_SHORT)


def test_text_and_binary_of_one_recording_agree():
    text, binary = (
        read_uff(CORPUS / f"Sample_UFF58{kind}.uff").recording.channels[0].block(0, 79_292)
        for kind in ("_ascii", "b_bin")
    )
    np.testing.assert_allclose(text, binary, rtol=1e-5)


@pytest.mark.parametrize("path", [*sorted(REAL.glob("*/*.uff")), *map(CORPUS.joinpath, RECORDINGS)])
def test_samples_equal_those_of_pyuff(path):
    found = read_uff(path)
    theirs = pyuff.UFF(str(path))
    sets = [theirs.read_sets(k) for k, n in enumerate(theirs.get_set_types()) if n == 58]
    if found.recording is None:
        ours, names = list(found.frf.values), found.frf_names
    else:
        channels = found.recording.channels
        ours, names = [each.samples for each in channels], found.recording.names
    for values, name, other in zip(ours, names, sets, strict=True):
        np.testing.assert_array_equal(values, other["data"])
        assert name == other["id1"].strip()


def test_ruler_has_ten_inertances_on_its_lines():
    frf = read_uff(REAL / "ruler_grid" / "frf.uff").frf
    assert frf.values.shape == (10, 3276)
    assert frf.node.tolist() == list(range(1, 11))
    assert frf.frequency_hz[1] == pytest.approx(0.6103515625, rel=1e-9)
    assert np.isnan(frf.coherence).all()
