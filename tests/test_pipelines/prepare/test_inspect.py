"""What `ringmodal inspect` tells of recordings, and what it finds wrong in them."""

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ema.core.finding import Check
from pipelines.cli.start import show_inspection
from pipelines.prepare.inspection import inspect_files

DATA = Path(__file__).parents[4] / "shared" / "data"
RATE_HZ = 1000.0
N = 20_000


def write(path, **columns):
    """A table with a time column; names such as ``A01__g`` carry their unit."""
    table = {"time [s]": np.arange(N) / RATE_HZ}
    for label, samples in columns.items():
        name, _, unit = label.partition("__")
        table[f"{name} [{unit.replace('_', '/')}]" if unit else name] = samples
    pd.DataFrame(table).to_parquet(path)
    return path


def noise(seed=0):
    return np.random.default_rng(seed).normal(size=N)


@pytest.fixture
def faulty(tmp_path):
    """A recording with one fault for each channel but the first."""
    t = np.arange(N) / RATE_HZ
    gap = noise(5)
    gap[[7, 9]] = np.nan
    held = noise(6)
    held[3000:5000] = held[3000]
    return write(
        tmp_path / "faulty.parquet",
        sound__N=noise(1),
        clipped__m_s2=np.clip(np.convolve(noise(2), np.ones(9), "same"), -4.5, 4.5),
        hums__m_s2=noise(3) + np.sin(2 * np.pi * 50 * t),
        loud__g=500 * noise(4),
        gap__m_s2=gap,
        held__m_s2=held,
        dead__m_s2=np.zeros(N),
    )


def rows(output):
    return {row["channel"]: row for row in json.loads(output)}


def test_each_fault_is_found_on_its_channel_alone(ringmodal, faulty):
    code, output, errors = ringmodal("inspect", faulty, "--json")
    assert (code, errors) == (0, "")
    found = {name: [f["check"] for f in row["findings"]] for name, row in rows(output).items()}
    assert found == {
        "sound": [],
        "clipped": ["clipped"],
        "hums": ["hum"],
        "loud": ["level"],
        "gap": ["missing samples"],
        "held": ["dropout"],
        "dead": ["silent"],
    }


def test_the_keys_of_a_channel(ringmodal, faulty):
    _, output, _ = ringmodal("inspect", faulty, "--json")
    sound, hums, gap = (rows(output)[name] for name in ("sound", "hums", "gap"))
    assert sound["file"] == "faulty.parquet"
    assert (sound["quantity"], sound["unit"], sound["node"]) == ("force", "N", None)
    assert (sound["sampling_rate_hz"], sound["n_samples"]) == (RATE_HZ, N)
    assert sound["rms"] == pytest.approx(1, rel=0.02)
    assert sound["peak"] == pytest.approx(sound["crest_factor"] * sound["rms_ac"], rel=0.02)
    assert sound["mean"] == pytest.approx(0, abs=0.03)
    assert hums["hum_hz"] == 50
    assert hums["hum_rms"] == pytest.approx(np.sqrt(0.5), rel=0.02)
    assert (gap["n_missing"], gap["first_missing"]) == (2, 7)


@pytest.mark.parametrize("columns", [80, 100, 120])
def test_the_table_fits_the_screen_and_cuts_no_number(ringmodal, faulty, monkeypatch, columns):
    monkeypatch.setenv("COLUMNS", str(columns))
    _, output, _ = ringmodal("inspect", faulty)
    table = [line for line in output.splitlines() if line.startswith(" ")]
    assert max(map(len, table)) <= columns
    assert "…" not in "".join(table)
    heading = " ".join(table[:3])
    assert "(SI)" in heading
    for word in ("channel", "clipped", "hum", "missing"):
        assert word in heading
    assert ("quantity" in heading) == (columns > 80)
    loud = next(line for line in table if line.lstrip().startswith("loud"))
    level = re.search(r" (4\d\d\d) ", loud)
    assert float(level[1]) == pytest.approx(4903, rel=0.02)


def test_faults_are_told_in_words_below(ringmodal, faulty):
    _, output, _ = ringmodal("inspect", faulty)
    assert output.startswith(f"{faulty}: PARQUET, ")
    assert "7 channels of 20000 samples at 1000 Hz, 20 s" in output
    wrong = [line for line in output.splitlines() if line.startswith("Looks wrong: ")]
    assert len(wrong) == 6
    assert "Looks wrong: dead: silent: it holds nothing but the value 0 m/s^2" in wrong


def test_columns_without_content_are_left_out(ringmodal, tmp_path):
    _, output, _ = ringmodal("inspect", write(tmp_path / "sound.parquet", A01__m_s2=noise()))
    for word in ("clipped", "hum", "missing", "node", "angle", "Looks wrong", "Note"):
        assert word not in output


def test_strict_refuses_what_looks_wrong(ringmodal, faulty, tmp_path):
    sound = write(tmp_path / "sound.parquet", A01__m_s2=noise())
    assert ringmodal("inspect", faulty, "--strict")[0] == 2
    assert ringmodal("inspect", sound, "--strict")[0] == 0


def test_bad_files_are_named_and_the_others_shown(ringmodal, tmp_path):
    write(tmp_path / "b.parquet", A01__m_s2=noise())
    (tmp_path / "a.uff").write_bytes(b"")
    (tmp_path / "c.parquet").write_bytes(b"PAR1")
    code, output, errors = ringmodal("inspect", tmp_path, tmp_path / "nowhere.uff")
    assert code == 2
    assert "b.parquet: PARQUET" in output
    lines = errors.splitlines()
    assert len(lines) == 3
    for line, name in zip(lines, ("a.uff", "c.parquet", "nowhere.uff"), strict=True):
        assert line.startswith("Error: ")
        assert name in line


@pytest.mark.parametrize("more", [[], ["--json"], ["--headers"]])
def test_a_wrong_path_is_one_message(ringmodal, tmp_path, more):
    code, output, errors = ringmodal("inspect", tmp_path / "nowhere", *more)
    assert (code, output) == (2, "")
    assert len(errors.splitlines()) == 1
    assert "not found" in errors


def test_an_empty_folder_is_one_message(ringmodal, tmp_path):
    code, output, errors = ringmodal("inspect", tmp_path)
    assert (code, output) == (2, "")
    assert "no recordings" in errors


def test_headers_alone_are_read_without_touching_signals(ringmodal, faulty):
    code, output, _ = ringmodal("inspect", faulty, "--headers")
    assert code == 0
    assert "loud" in output
    for word in ("rms", "Looks wrong", "Levels"):
        assert word not in output
    _, output, _ = ringmodal("inspect", faulty, "--headers", "--json")
    assert "rms" not in rows(output)["loud"]
    assert rows(output)["loud"]["n_samples"] == N


def test_a_folder_in_the_order_of_its_numbers(tmp_path):
    for number in (10, 9, 1):
        write(tmp_path / f"run_{number}.parquet", A01__m_s2=noise())
    found = inspect_files([tmp_path])
    assert [report.path.name for report in found.files] == [
        "run_1.parquet",
        "run_9.parquet",
        "run_10.parquet",
    ]


def test_the_manifest_gives_rate_and_calibration(tmp_path):
    pd.DataFrame({"A01 [V]": 0.01 * noise(), "other": noise()}).to_parquet(tmp_path / "a.parquet")
    write(tmp_path / "unlisted.parquet", A01__m_s2=noise())
    (tmp_path / "campaign.toml").write_text(
        "schema = 1\n[acquisition]\nsampling_rate_hz = 500.0\n"
        '[calibration]\n"A*" = { sensitivity = "10 mV/(m/s^2)" }\n'
        '[[runs]]\nfile = "a.parquet"\n'
    )
    (listed,) = inspect_files([tmp_path / "campaign.toml"]).files
    assert listed.sampling_rate_hz == 500
    assert listed.channels[0].signal.rms_ac == pytest.approx(1, rel=0.02)
    assert listed.channels[0].channel.quantity == "acceleration"
    assert len(inspect_files([tmp_path]).files) == 1  # a sensitivity for what is in m/s^2
    assert len(inspect_files([tmp_path]).errors) == 1


def test_what_the_manifest_has_to_say_is_noted(ringmodal, tmp_path):
    columns = {"A01 [V]": noise(), "A02": noise(1), "A03": noise(2)}
    pd.DataFrame(columns).to_parquet(tmp_path / "a.parquet")
    code, output, _ = ringmodal("inspect", tmp_path, "--strict")
    notes = [line for line in output.splitlines() if line.startswith("Note: ")]
    assert code == 0
    assert [note.split(":")[1].strip() for note in notes] == ["sampling rate", "A01", "A02, A03"]


def test_a_faulty_manifest_does_not_hide_the_recordings(tmp_path):
    write(tmp_path / "a.parquet", A01__m_s2=noise())
    (tmp_path / "campaign.toml").write_text("schema = 2\n")
    found = inspect_files([tmp_path])
    assert len(found.files) == len(found.errors) == 1
    assert found.looks_wrong


def test_names_cannot_write_on_the_terminal(ringmodal, tmp_path):
    columns = {"[/red] [m/s^2]": noise(), "\x1b[31mA02 [m/s^2]": noise(1)}
    pd.DataFrame(columns).to_parquet(tmp_path / "[b].parquet")
    code, output, _ = ringmodal("inspect", tmp_path)
    assert code == 0
    assert "\x1b" not in output
    assert "[b].parquet: PARQUET" in output
    assert "[/red]" in output


def test_what_the_reader_says_is_not_said_again(tmp_path):
    (tmp_path / "gap.csv").write_text("time [s],A [N]\n0,1\n0.1,\n0.2,2\n0.3,1\n")
    (report,) = inspect_files([tmp_path]).files
    assert report.channels[0].signal.n_missing == 1
    assert [finding.check for finding in report.wrong] == ["missing samples"]


@settings(max_examples=40)
@given(
    st.text(max_size=12),
    st.sampled_from(["", "g", "N", "V", "Pa"]),
    st.lists(st.floats(), min_size=1, max_size=30),
    st.booleans(),
)
def test_any_samples_and_names_are_shown(tmp_path_factory, name, unit, samples, as_json):
    path = tmp_path_factory.mktemp("any") / "a.parquet"
    label = f"{name} [{unit}]" if unit else f"A{name}"
    pd.DataFrame({label.encode("utf-8", "replace").decode(): samples}).to_parquet(path)
    found = inspect_files([path])
    assert len(found.files) + len(found.errors) == 1
    show_inspection(found, as_json=as_json)


def test_two_channels_of_one_name(faulty, tmp_path):
    twice = tmp_path / "twice.csv"
    twice.write_text("time [s],A [N],A [N]\n" + "".join(f"{k / 100},{k},{k}\n" for k in range(9)))
    (report,) = inspect_files([twice], levels=False).files
    assert [finding.check for finding in report.wrong] == ["name"]


def test_the_sample_campaign_looks_right(ringmodal, sample_campaign):
    code, output, errors = ringmodal("inspect", sample_campaign / "campaign.toml", "--strict")
    assert (code, errors) == (0, "")
    assert output.count("14 channels of 40000 samples at 2000 Hz, 20 s") == 6


def test_frfs_are_listed(ringmodal):
    path = DATA / "real" / "ruler_grid" / "frf.uff"
    if not path.exists():
        pytest.skip("measured data are not at hand")
    code, output, _ = ringmodal("inspect", path)
    assert code == 0
    assert "10 FRFs of 3276 lines, 0 to 1999 Hz" in output
    assert re.search(r"ruler grid point 10 +10", output)
    _, output, _ = ringmodal("inspect", path, "--json")
    found = json.loads(output)
    assert [row["node"] for row in found] == list(range(1, 11))
    assert {row["kind"] for row in found} == {"FRF"}


def test_every_file_of_the_corpus_is_read_or_named(ringmodal, tmp_path):
    corpus = DATA / "uff_corpus"
    if not corpus.exists():
        pytest.skip("the corpus is not at hand")
    paths = sorted(corpus.glob("*.uff"))
    _, output, errors = ringmodal("inspect", *paths, "--headers")
    for path in paths:
        assert f"{path.name}: UFF" in output or path.name in errors
    geometry = corpus / "mesh_Oros-modal_uff15_uff2412.uff"
    shutil.copy(geometry, tmp_path / "geometry.uff")
    code, output, _ = ringmodal("inspect", tmp_path / "geometry.uff", "--strict")
    assert code == 0
    assert "neither time series nor FRFs" in output
    assert "Note: content: " in output


def test_frfs_without_unit_need_the_manifest(tmp_path):
    rows = "".join(f"{k},{k},1\n" for k in range(1, 9))
    (tmp_path / "a.csv").write_text(f"f [Hz],H real,H imag\n{rows}")
    (report,) = inspect_files([tmp_path]).files
    assert [each.check for each in report.wrong] == [Check.UNIT]
    manifest = 'schema = 1\n[acquisition]\nfrf_unit = "g/N"\n[[runs]]\nfile = "a.csv"\n'
    (tmp_path / "campaign.toml").write_text(manifest)
    (report,) = inspect_files([tmp_path]).files
    assert not report.wrong
    np.testing.assert_allclose(report.frf.values[0, 0], 9.80665 * (1 + 1j))
