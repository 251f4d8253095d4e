"""The ring model on the command line: numbers, files, exit codes and messages."""

import csv
import json
import re
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from scipy.integrate import trapezoid

from model import Bifurcation, ForcedRing, inertance, loaded_frequencies_hz, natural_frequencies_hz
from model.parameters import TABLE_4_RING, TABLE_5_DAMPING
from pipelines.cli import show_tyre
from pipelines.simulate.responses import tyre_to_simulate

# Table 4 with 2.2 bar at 80 km/h, rotating frame
REGRESSIVE_HZ = [86.219, 110.131, 131.392, 155.142, 181.178, 208.974, 238.167]
PROGRESSIVE_HZ = [64.799, 92.890, 118.454, 144.995, 172.885, 201.980, 232.129]


@pytest.fixture
def sample_tyre(sample_campaign):
    return sample_campaign.with_suffix(".toml")


@pytest.fixture
def narrow_tyre(sample_tyre, tmp_path):
    """The sample tyre without belt width."""
    lines = sample_tyre.read_text(encoding="utf-8").splitlines()
    path = tmp_path / "narrow.toml"
    path.write_text("\n".join(line for line in lines if "belt_width" not in line), "utf-8")
    return path


def columns_of(path):
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    return {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}


def test_frequencies_at_80_km_h_as_json_and_nothing_else(ringmodal, sample_tyre):
    code, output, errors = ringmodal(
        *("simulate", "frequencies", "--tyre", sample_tyre, "--speed-rad-s", 67.3),
        *("--orders", "1:7", "--frame", "rotating", "--json"),
    )
    found = json.loads(output)
    assert (code, errors) == (0, "")
    assert list(found) == ["orders", "regressive_hz", "progressive_hz"]
    assert found["orders"] == [1, 2, 3, 4, 5, 6, 7]
    np.testing.assert_allclose(found["regressive_hz"], REGRESSIVE_HZ, atol=6e-4)
    np.testing.assert_allclose(found["progressive_hz"], PROGRESSIVE_HZ, atol=6e-4)


def test_the_tyre_of_a_result_folder(ringmodal, sample_tyre, tmp_path):
    folder = tmp_path / "result"
    folder.mkdir()
    (folder / "tyre.toml").write_bytes(Path(sample_tyre).read_bytes())
    command = ("simulate", "frequencies", "--tyre")
    assert ringmodal(*command, folder) == ringmodal(*command, sample_tyre)
    code, _, errors = ringmodal(*command, tmp_path)
    assert (code, "no tyre.toml" in errors) == (2, True)


def test_without_a_tyre_it_is_the_sample_and_standard_error_says_so(ringmodal, sample_tyre):
    command = ("simulate", "frequencies", "--json")
    code, output, errors = ringmodal(*command)
    assert code == 0
    assert errors.startswith("No --tyre given") and "225/55R17" in errors
    assert output == ringmodal(*command, "--tyre", sample_tyre)[1]


@pytest.mark.parametrize(
    ("frame", "regressive_hz", "progressive_hz"),
    [
        ("absolute", 131.392 - 3 * 67.3 / (2 * np.pi), 118.454 + 3 * 67.3 / (2 * np.pi)),
        ("stationary", (131.392 + 118.454) / 2, (131.392 + 118.454) / 2),
    ],
)
def test_frames(ringmodal, frame, regressive_hz, progressive_hz):
    _, output, _ = ringmodal(
        *("simulate", "frequencies", "--speed-rad-s", 67.3, "--orders", 3),
        *("--frame", frame, "--json"),
    )
    found = json.loads(output)
    assert found["regressive_hz"] == [pytest.approx(regressive_hz, abs=1e-3)]
    assert found["progressive_hz"] == [pytest.approx(progressive_hz, abs=1e-3)]


def test_several_speeds_make_a_table_and_a_figure(ringmodal, tmp_path):
    table, figure = tmp_path / "waves.csv", tmp_path / "waves.svg"
    code, output, _ = ringmodal(
        *("simulate", "frequencies", "--speed-rad-s", "0:67.3:67.3", "--orders", "1:7"),
        *("--out", table, "--figure", figure),
    )
    found = columns_of(table)
    assert code == 0
    assert output.splitlines() == [f"Table: {table}", f"Figure: {figure}"]
    assert list(found)[:4] == ["speed_rad_s", "order", "regressive_hz", "progressive_hz"]
    np.testing.assert_array_equal(found["speed_rad_s"], np.repeat([0, 67.3], 7))
    at_rest = natural_frequencies_hz(TABLE_4_RING, range(1, 8))
    np.testing.assert_allclose(found["regressive_hz"][:7], at_rest, rtol=1e-9)
    np.testing.assert_allclose(found["progressive_hz"][7:], PROGRESSIVE_HZ, atol=6e-4)
    assert figure.read_text(encoding="utf-8").startswith("<?xml")


def test_json_over_speed_has_one_list_per_order(ringmodal):
    _, output, _ = ringmodal(
        "simulate", "frequencies", "--speed-rad-s", "0,10,20", "--orders", "1:2", "--json"
    )
    found = json.loads(output)
    assert found["speed_rad_s"] == [0.0, 10.0, 20.0]
    assert np.shape(found["regressive_hz"]) == (2, 3)


def test_an_instability_is_named_and_has_no_frequency(capsys):
    grows = np.array([[0.0, 0.0, 5.0]])
    hz = np.where(grows > 0, np.nan, 100.0)
    found = Bifurcation(np.array([2]), np.array([0.0, 10.0, 20.0]), hz, hz, grows, "rotating")
    show_tyre.frequencies(
        found, "rotating", show_tyre.Request(tyre_to_simulate(None), None, None, True)
    )
    captured = capsys.readouterr()
    assert json.loads(captured.out)["regressive_hz"] == [[100.0, 100.0, None]]
    assert "Order 2 is unstable at 20 rad/s, where it grows by 5 1/s" in captured.err


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_inertance_is_that_of_the_model(ringmodal, tmp_path, ending):
    table = tmp_path / f"inertance.{ending}"
    code, _, _ = ringmodal(
        *("simulate", "inertance", "--at-deg", 100, "--force-deg", 20, "--speed-rad-s", 67.3),
        *("--frequency-hz", "50:60:5", "--harmonics", 40, "--no-pretension-loss", "--out", table),
    )
    assert code == 0
    if ending == "csv":
        found = columns_of(table)
    else:
        stored = pq.read_table(table)
        found = {name: stored[name].to_numpy() for name in stored.column_names}
        assert b"(m/s\xc2\xb2)/N" in stored.schema.metadata[b"note"]
    assert list(found) == ["frequency_hz", "real", "imag", "magnitude", "phase_deg"]
    damping = type(TABLE_5_DAMPING)(1.9e3, 1.5e3, 2.5e-2, on_pretension=False)
    forced = ForcedRing(TABLE_4_RING, damping, 67.3, highest_order=40)
    expected = inertance(forced, [50.0, 55.0, 60.0], np.deg2rad(100.0), np.deg2rad(20.0))
    np.testing.assert_allclose(found["real"] + 1j * found["imag"], expected, rtol=1e-12)
    np.testing.assert_allclose(found["magnitude"], np.abs(expected), rtol=1e-12)
    np.testing.assert_allclose(found["phase_deg"], np.rad2deg(np.angle(expected)), rtol=1e-12)


def test_inertance_without_belt_width_is_per_width_and_says_so(ringmodal, narrow_tyre):
    code, output, errors = ringmodal("simulate", "inertance", "--tyre", narrow_tyre)
    assert code == 0
    assert "per unit of belt width" in errors
    assert "(m/s²)/(N/m)" in output
    rows = [line.split() for line in output.splitlines() if line.strip()[:1].isdigit()]
    peaks = np.array(rows, dtype=float)
    at_rest = [75.4, 103.8, 116.4, 148.6, 168.1, 222.6, 283.8]
    np.testing.assert_allclose(peaks[:, 0], at_rest, atol=0.1)
    heights = [0.041, 0.253, 0.233, 0.305, 0.339, 0.489, 0.590]
    np.testing.assert_allclose(peaks[:, 1], heights, atol=6e-4)


def test_few_lines_are_printed_as_they_are(ringmodal):
    _, output, _ = ringmodal("simulate", "inertance", "--frequency-hz", "75.4")
    row = next(line.split() for line in output.splitlines() if line.strip()[:1].isdigit())
    assert float(row[0]) == 75.4
    assert float(row[3]) == pytest.approx(0.041 / 0.19, rel=0.01)


def test_inextensional_belt(ringmodal):
    command = ("simulate", "inertance", "--frequency-hz", "80:120:10", "--json")
    exact = json.loads(ringmodal(*command)[1])
    inextensional = json.loads(ringmodal(*command, "--inextensional")[1])
    assert exact["magnitude"] != inextensional["magnitude"]
    np.testing.assert_allclose(inextensional["magnitude"], exact["magnitude"], rtol=0.05)


def test_cleat_writes_time_and_spectrum(ringmodal, tmp_path):
    table, spectrum, figure = (tmp_path / name for name in ("t.csv", "f.parquet", "c.png"))
    code, _, _ = ringmodal(
        *("simulate", "cleat", "--harmonics", 20, "--times-s", "0:0.5:0.0002"),
        *("--frequency-hz", "60,90", "--out", table, "--spectrum", spectrum, "--figure", figure),
    )
    found, transform = columns_of(table), pq.read_table(spectrum)
    assert code == 0
    assert list(found) == ["time_s", "acceleration"]
    assert transform.column_names == ["frequency_hz", "real", "imag", "magnitude", "phase_deg"]
    for row, frequency_hz in enumerate((60.0, 90.0)):
        turns = np.exp(-2j * np.pi * frequency_hz * found["time_s"])
        expected = trapezoid(found["acceleration"] * turns, found["time_s"])
        stored = transform["real"][row].as_py() + 1j * transform["imag"][row].as_py()
        assert stored == pytest.approx(expected, rel=0.005)
    assert figure.read_bytes().startswith(b"\x89PNG")


def test_a_point_in_space_feels_another_blow_than_one_on_the_tyre(ringmodal):
    command = ("simulate", "cleat", "--times-s", "0.01:0.02:0.01", "--frequency-hz", 90, "--json")
    on_tyre = json.loads(ringmodal(*command)[1])["acceleration"]
    in_space = json.loads(ringmodal(*command, "--frame", "absolute")[1])["acceleration"]
    standing = (*command, "--speed-rad-s", 0)
    assert not np.allclose(on_tyre, in_space, rtol=0.01)
    assert ringmodal(*standing)[1] == ringmodal(*standing, "--frame", "absolute")[1]


def test_loaded_tyre(ringmodal, tmp_path):
    table, figure = tmp_path / "loaded.csv", tmp_path / "loaded.png"
    code, output, _ = ringmodal(
        *("simulate", "loaded", "--load-n", "0,2000", "--modes", 5, "--harmonics", 20),
        *("--out", table, "--figure", figure),
    )
    found = columns_of(table)
    assert code == 0
    belt, tread, road = (float(each) for each in re.findall(r"([\d.]+) mm", output)[:3])
    assert 0 < tread < 1 and belt + tread == pytest.approx(road, abs=0.011)
    names = ["load_n", "mode", "frequency_hz", "dominant_order"]
    assert list(found) == [*names, "deflection_m", "patch_length_m", "stiffness_n_m"]
    assert found["patch_length_m"].tolist()[:5] == [0.0] * 5
    assert found["deflection_m"][5:].tolist() == [pytest.approx(0.00619, rel=0.01)] * 5
    at_rest = natural_frequencies_hz(TABLE_4_RING, [1, 2])
    np.testing.assert_allclose(found["frequency_hz"][1:5], np.repeat(at_rest, 2), rtol=1e-6)
    np.testing.assert_array_equal(found["dominant_order"][:5], [0, 1, 1, 2, 2])
    assert found["load_n"].tolist() == [0.0] * 5 + [2000.0] * 5
    assert figure.read_bytes().startswith(b"\x89PNG")


def test_without_a_tread_the_contact_pressure_is_given(ringmodal):
    command = ("simulate", "loaded", "--load-n", 3000, "--modes", 12, "--harmonics", 20, "--json")
    given = json.loads(ringmodal(*command, "--tread-radial-n-m3", 0)[1])
    expected, _ = loaded_frequencies_hz(TABLE_4_RING, 3000.0, 12, highest_order=20)
    np.testing.assert_allclose(given["frequency_hz"], expected, rtol=1e-12)
    held = json.loads(ringmodal(*command)[1])
    assert "stiffness_n_m" in held and "stiffness_n_m" not in given
    assert np.all(np.array(held["frequency_hz"]) > np.array(given["frequency_hz"]))


def test_a_free_wheel_on_the_road_rolls_and_hops(ringmodal):
    wheel = ("--hub", "free", "--wheel-mass-kg", 12, "--wheel-inertia-kg-m2", 0.6)
    command = ("simulate", "loaded", "--load-n", 4000, "--modes", 4, "--harmonics", 20)
    code, output, _ = ringmodal(*command, *wheel, "--json")
    found = json.loads(output)
    frequencies = found["frequency_hz"][0]
    belt_kg, stiffness = 2 * np.pi * 0.33 * 0.19 * 19.69, found["stiffness_n_m"][0]
    whole, bare = (np.sqrt(stiffness / mass) / (2 * np.pi) for mass in (12 + belt_kg, 12))
    assert code == 0 and frequencies[0] < 0.2
    assert whole < frequencies[1] < bare  # the patch stands still and bears a part of the belt
    assert ringmodal(*command, *wheel, "--tread-radial-n-m3", 0)[0] == 2


def test_a_slow_force_arrives_at_a_fixed_hub_whole(ringmodal):
    command = ("simulate", "hub", "--force-deg", 30, "--frequency-hz", 0.01, "--json")
    found = json.loads(ringmodal(*command)[1])
    assert found["force_x_real"][0] == pytest.approx(np.cos(np.pi / 6), rel=1e-6)
    assert found["force_z_real"][0] == pytest.approx(np.sin(np.pi / 6), rel=1e-6)
    assert "x_m_n_real" not in found


def test_a_free_wheel_moves_and_its_frequencies_are_shown(ringmodal, tmp_path):
    wheel = ("--hub", "free", "--wheel-mass-kg", 12, "--wheel-inertia-kg-m2", 0.6)
    figure = tmp_path / "hub.svg"
    code, output, _ = ringmodal("simulate", "hub", *wheel, "--figure", figure)
    found = json.loads(ringmodal("simulate", "hub", *wheel, "--json")[1])
    assert code == 0
    assert "with the free wheel" in output and "96.885" in output
    assert np.abs(found["x_m_n_real"]).max() > 0
    assert figure.is_file()


def test_the_wheel_of_the_parameter_set_counts(ringmodal, sample_tyre, tmp_path):
    tyre = tmp_path / "tyre.toml"
    wheel = "\n[wheel]\nmass_kg = 12.0\ninertia_kg_m2 = 0.6\n"
    tyre.write_text(sample_tyre.read_text(encoding="utf-8") + wheel, "utf-8")
    command = ("simulate", "hub", "--hub", "free", "--tyre", tyre, "--json")
    same = ringmodal(*command, "--wheel-mass-kg", 12, "--wheel-inertia-kg-m2", 0.6)
    heavier = ringmodal(*command, "--wheel-mass-kg", 14)
    assert ringmodal(*command)[1] == same[1] != heavier[1]


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("frequencies", "--orders", "1:x"), "'1:x'"),
        (("frequencies", "--orders", "1.5"), "whole numbers"),
        (("frequencies", "--orders", "0:3"), "n ≥ 1"),
        (("frequencies", "--speed-rad-s", "9000"), "speed_rad_s: 9000"),
        (("frequencies", "--speed-rad-s", "100:0:1"), "'100:0:1'"),
        (("frequencies", "--speed-rad-s", "0:1:1e-9"), "at most 100000 values"),
        (("frequencies", "--out", "waves.txt"), "'.txt'"),
        (("frequencies", "--figure", "waves.gif"), "'.gif'"),
        (("frequencies", "--out", "no_folder/waves.csv"), "does not exist"),
        (("frequencies", "--tyre", "nowhere.toml"), "nowhere.toml"),
        (("inertance", "--frequency-hz", "10:20:nan"), "nan"),
        (("cleat", "--duration-s", "-1"), "duration_s"),
        (("loaded", "--load-n", "90000"), "load_n: 90000"),
        (("loaded", "--load-n", "90000", "--tread-radial-n-m3", "0"), "half angle"),
        (("loaded", "--tread-radial-n-m3", "-1"), "tread radial_n_m3: -1"),
        (("loaded", "--load-n", "0", "--modes", "500"), "1 to 242 modes"),
        (("loaded", "--load-n", "-100"), "load_n: -100"),
        (("hub", "--hub", "free"), "wheel"),
        (
            ("hub", "--hub", "free", "--wheel-mass-kg", "0", "--wheel-inertia-kg-m2", "1"),
            "mass_kg: 0",
        ),
    ],
)
def test_bad_input_ends_with_one_message(ringmodal, tmp_path, monkeypatch, arguments, says):
    monkeypatch.chdir(tmp_path)
    code, output, errors = ringmodal("simulate", *arguments)
    lines = [line for line in errors.splitlines() if not line.startswith("No --tyre given")]
    assert (code, output) == (2, "")
    assert len(lines) == 1
    assert lines[0].startswith("Error: ") and says in lines[0]
    assert list(tmp_path.iterdir()) == []


def test_a_value_that_makes_no_ring_is_named_with_its_file(ringmodal, sample_tyre, tmp_path):
    tyre = tmp_path / "odd.toml"
    text = sample_tyre.read_text(encoding="utf-8")
    tyre.write_text(text.replace("8270000.0", "-8270000.0"), "utf-8")
    code, output, errors = ringmodal("simulate", "frequencies", "--tyre", tyre)
    assert (code, output) == (2, "")
    assert errors.startswith(f"Error: {tyre}, radial_stiffness_n_m3: -8.27e+06; ")


@pytest.mark.parametrize("frame", ["moon", ""])
def test_an_unknown_frame_is_a_usage_error(ringmodal, frame):
    code, output, errors = ringmodal("simulate", "frequencies", "--frame", frame)
    assert (code, output) == (2, "")
    assert "rotating" in errors


@pytest.mark.parametrize("command", ["inertance", "cleat", "hub"])
def test_forced_vibration_needs_damping(ringmodal, sample_tyre, tmp_path, command):
    tyre = tmp_path / "undamped.toml"
    text = sample_tyre.read_text(encoding="utf-8")
    start, end = text.index("[damping]"), text.index("[provenance]")
    tyre.write_text(text[:start] + text[end:], "utf-8")
    code, output, errors = ringmodal("simulate", command, "--tyre", tyre)
    assert (code, output) == (2, "")
    assert "no section [damping]" in errors


@pytest.mark.parametrize("command", ["cleat", "loaded", "hub"])
def test_forces_in_newton_need_a_belt_width(ringmodal, narrow_tyre, command):
    code, output, errors = ringmodal("simulate", command, "--tyre", narrow_tyre)
    assert (code, output) == (2, "")
    assert "belt_width_m" in errors


@pytest.mark.parametrize("command", ["frequencies", "inertance", "cleat", "loaded", "hub"])
def test_help_has_one_example(ringmodal, command):
    code, output, _ = ringmodal("simulate", command, "--help")
    assert code == 0
    assert re.search(rf"Example:\n +ringmodal simulate {command} --", output)
