"""A draft manifest says what the recordings tell, and names what they do not."""

import re
import shutil
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import systems
from builders import force58, nodes15, response58
from hypothesis import given, settings
from hypothesis import strategies as st

import ema
from ema.core.errors import InputError
from ema.io.campaign.manifest import read_manifest
from ema.io.uff.write import write_frfs
from pipelines.prepare.inspection import Layout
from pipelines.prepare.manifest_template import draft_manifest, write_draft
from pipelines.process.run import process
from pipelines.results.options import Options


@pytest.fixture
def bare(short_campaign, tmp_path):
    """The recordings of a campaign without its manifest."""
    folder = tmp_path / "bare"
    folder.mkdir()
    for path in short_campaign.glob("*.uff"):
        shutil.copy(path, folder)
    return folder


def test_recordings_with_nodes_need_only_pressure_and_radius(bare):
    draft = draft_manifest(bare)
    assert len(draft.missing) == 1
    assert "inflation_pressure_pa and mean_radius_m" in draft.missing[0]
    content = tomllib.loads(draft.text)
    assert content["grid"]["positions"] == 72
    assert content["excitation"]["channel"] == "force"
    assert [run["reference"] for run in content["runs"]] == ["REF"] * 6
    assert content["acquisition"]["sampling_rate_hz"] == 2000.0


def test_a_filled_in_draft_gives_the_modes_of_the_manifest(bare, short_result):
    path = write_draft(bare, draft_manifest(bare))
    text = path.read_text(encoding="utf-8")
    text = text.replace("# inflation_pressure_pa = <Pa>", "inflation_pressure_pa = 220000.0")
    path.write_text(text.replace("# mean_radius_m = <m>", "mean_radius_m = 0.33"), encoding="utf-8")
    result = process(bare, Options())
    assert result.tuning is not None
    found = [mode.frequency_hz for mode in result.modal_model.modes]
    assert found == [mode.frequency_hz for mode in short_result.modal_model.modes]


def test_an_existing_manifest_is_kept(bare):
    draft = draft_manifest(bare)
    write_draft(bare, draft)
    with pytest.raises(InputError, match="--force"):
        write_draft(bare, draft)
    assert write_draft(bare, draft, force=True).is_file()


def test_a_folder_without_recordings_is_refused(tmp_path):
    with pytest.raises(InputError, match="no recordings"):
        draft_manifest(tmp_path)


SHARED = Path(__file__).parents[4] / "shared" / "data"


def write(folder, name, labels, rate_hz=1000.0):
    """A recording with these channels, each with its unit in brackets, of noise."""
    rng = np.random.default_rng(len(name))
    table = {label: rng.normal(size=2000) for label in labels}
    if rate_hz is not None:
        table = {"time [s]": np.arange(2000) / rate_hz, **table}
    pd.DataFrame(table).to_parquet(folder / name)


def drafted(folder):
    """Draft, and what its text says; it has to be a manifest as it stands."""
    draft = draft_manifest(folder)
    path = write_draft(folder, draft, force=True)
    read_manifest(path)
    return draft, tomllib.loads(draft.text)


def filled_in(folder, **values):
    """Fill in and uncomment the lines of a draft that begin with these keys."""
    path = folder / "campaign.toml"
    text = path.read_text(encoding="utf-8")
    for key, value in values.items():
        text, count = re.subn(rf'^# "?{key}"? = .*$', f"{key} = {value}", text, flags=re.MULTILINE)
        assert count
    path.write_text(text, encoding="utf-8")
    return ema.read_campaign(folder)


def with_data_of_the_tyre(folder):
    return filled_in(folder, inflation_pressure_pa="2.2e5", mean_radius_m="0.33")


def angles_of(campaign):
    return [response.position_deg for run in campaign.runs for response in run.responses]


def test_the_manifest_removed_from_the_sample_campaign(sample_campaign, tmp_path):
    for path in sample_campaign.glob("*.uff"):
        shutil.copy(path, tmp_path)
    draft, _ = drafted(tmp_path)
    assert len(draft.missing) == 1
    original, again = ema.read_campaign(sample_campaign), with_data_of_the_tyre(tmp_path)
    assert angles_of(again) == angles_of(original)
    assert [run.force.name for run in again.runs] == [run.force.name for run in original.runs]
    assert [run.reference.name for run in again.runs] == ["REF"] * 6
    assert again.excitation_deg == original.excitation_deg == 0


def test_angles_in_names(tmp_path):
    for run in (1, 2):
        names = [f"A{k:02d}_{30 * k + 15 * (run - 1):03d}deg [g]" for k in range(12)]
        write(tmp_path, f"run_{run}.parquet", ["F [N]", *names, "Ref [g]"])
    draft, content = drafted(tmp_path)
    assert len(draft.missing) == 1
    assert content["grid"]["positions"] == 24
    assert content["runs"][1]["positions_deg"]["A03_105deg"] == 105.0
    assert [run["reference"] for run in content["runs"]] == ["Ref", "Ref"]
    assert angles_of(with_data_of_the_tyre(tmp_path)) == [*range(0, 360, 30), *range(15, 360, 30)]


@pytest.mark.parametrize("form", ["{}°", "{}.0 deg", "CH {} deg +Z", "{},0grad"])
def test_forms_of_angles(tmp_path, form):
    names = [f"{form.format(angle)} [m/s^2]" for angle in (0, 90, 180, 270)]
    write(tmp_path, "a.parquet", ["force [N]", *names])
    draft, _ = drafted(tmp_path)
    assert len(draft.missing) == 1
    assert angles_of(with_data_of_the_tyre(tmp_path)) == [0, 90, 180, 270]


def test_numbers_of_positions_in_names(tmp_path):
    for first in (1, 13):
        names = [f"P{k} [m/s^2]" for k in range(first, first + 12)]
        write(tmp_path, f"run_{first}.parquet", ["force [N]", *names])
    draft, content = drafted(tmp_path)
    assert len(draft.missing) == 1
    assert content["grid"]["positions"] == 24
    assert angles_of(with_data_of_the_tyre(tmp_path)) == [*range(15, 360, 15), 0]


@pytest.mark.parametrize(
    "names",
    [
        ["A01", "A02", "A03"],  # sensors, wherever they sit
        ["P1", "P2", "P7"],  # no circle
        ["P1", "P2", "Q3"],
        ["A_30deg", "B_30deg", "C_60deg"],  # two at one place
        ["30deg_60deg", "90deg", "120deg"],
        ["A_400deg", "A_30deg", "A_60deg"],
    ],
)
def test_names_that_tell_no_places(tmp_path, names):
    write(tmp_path, "a.parquet", ["force [N]", *(f"{name} [g]" for name in names)])
    draft, content = drafted(tmp_path)
    assert "grid" not in content
    assert "positions_deg" not in content["runs"][0]
    assert "positions_deg of each run" in draft.missing[-1]
    for name in names:
        assert re.search(rf"^# positions_deg = .*{name} = <deg>", draft.text, re.MULTILINE)


def test_volts_need_their_sensitivities(tmp_path):
    write(tmp_path, "a.parquet", ["Kraft [V]", "A_0deg [V]", "A_120deg [V]", "A_240deg [V]"])
    draft, content = drafted(tmp_path)
    assert draft.missing[1:] == (
        "[calibration] sensitivity of Kraft, A_0deg, A_120deg, A_240deg, in volts",
    )
    assert content["excitation"]["channel"] == "Kraft"
    assert '# Kraft = { sensitivity = "<number> mV/N" }' in draft.text
    assert '# A_0deg = { sensitivity = "<number> mV/g" }' in draft.text
    with_data_of_the_tyre_and = {"inflation_pressure_pa": "2.2e5", "mean_radius_m": "0.33"}
    sensors = dict.fromkeys(("A_0deg", "A_120deg", "A_240deg"), '{ sensitivity = "10 mV/g" }')
    campaign = filled_in(
        tmp_path, **with_data_of_the_tyre_and, **sensors, Kraft='{ sensitivity = "2 mV/N" }'
    )
    assert angles_of(campaign) == [0, 120, 240]
    assert campaign.runs[0].force.block(0, 2000).std() == pytest.approx(500, rel=0.1)


def test_channels_without_units_are_named_and_taken_as_si(tmp_path):
    write(tmp_path, "a.parquet", ["load cell", "0deg", "120deg", "240deg"], rate_hz=None)
    draft, content = drafted(tmp_path)
    assert content["excitation"]["channel"] == "load cell"
    assert "[acquisition] sampling_rate_hz, which the files do not state" in draft.missing
    assert (
        "[calibration] unit of load cell, 0deg, 120deg, 240deg; taken as SI without one"
    ) in draft.missing
    campaign = filled_in(
        tmp_path, inflation_pressure_pa="2e5", mean_radius_m="0.3", sampling_rate_hz="500.0"
    )
    assert angles_of(campaign) == [0, 120, 240]
    assert campaign.runs[0].recording.sampling_rate_hz == 500


def test_a_tacho_in_volts_beside_accelerations_needs_nothing(tmp_path):
    write(tmp_path, "a.parquet", ["force [N]", "0deg [g]", "120deg [g]", "240deg [g]", "tacho [V]"])
    draft, content = drafted(tmp_path)
    assert len(draft.missing) == 1
    assert "calibration" not in content


def test_several_forces_are_listed(tmp_path):
    write(tmp_path, "a.parquet", ["Fx [N]", "Fz [N]", "0deg [g]", "120deg [g]", "240deg [g]"])
    draft, content = drafted(tmp_path)
    assert "channel" not in content["excitation"]
    assert "[excitation] channel, the force, one of 0deg, 120deg, 240deg, Fx, Fz" in draft.missing


def test_a_force_of_another_name_in_each_run_needs_no_naming(tmp_path):
    for number in (1, 2):
        names = [f"{angle + 60 * number}deg [g]" for angle in (0, 120, 240)]
        write(tmp_path, f"{number}.parquet", [f"force {number} [N]", *names])
    draft, content = drafted(tmp_path)
    assert len(draft.missing) == 1
    assert "channel" not in content["excitation"]
    assert [run.force.name for run in with_data_of_the_tyre(tmp_path).runs] == [
        "force 1",
        "force 2",
    ]


def test_different_rates_are_said(tmp_path):
    for rate_hz in (500.0, 1000.0):
        write(tmp_path, f"{rate_hz:g}.parquet", ["force [N]", "A [g]"], rate_hz)
    draft, _ = drafted(tmp_path)
    assert "one sampling rate: the files have 500 Hz, 1000 Hz" in draft.missing


def test_a_broken_file_is_named_and_the_others_drafted(ringmodal, bare):
    (bare / "config_3.uff").write_bytes((bare / "config_3.uff").read_bytes()[:70_000])
    code, output, errors = ringmodal("init", bare)
    assert code == 0
    assert re.fullmatch(r"Left out: config_3.uff, dataset \d+: .+ truncated\. .+\n", errors)
    assert "Template: " in output
    manifest = read_manifest(bare / "campaign.toml")
    assert [run.file for run in manifest.runs] == [f"config_{k}.uff" for k in (1, 2, 4, 5, 6)]
    assert '# file = "config_3.uff"' in (bare / "campaign.toml").read_text(encoding="utf-8")


def test_nothing_but_broken_files(tmp_path):
    (tmp_path / "a.uff").write_bytes(b"")
    with pytest.raises(InputError, match=r"a\.uff: the file is empty"):
        draft_manifest(tmp_path)


def test_some_runs_of_a_grid_make_it_a_guess(bare):
    for number in (4, 5, 6):
        (bare / f"config_{number}.uff").unlink()
    draft, content = drafted(bare)
    assert content["grid"]["positions"] == 72
    assert draft.missing[-1] == "[grid] positions: 72 is a guess from the node numbers"


def test_one_run_of_a_grid_tells_its_step(bare):
    for number in range(2, 7):
        (bare / f"config_{number}.uff").unlink()
    draft, content = drafted(bare)
    assert content["grid"]["positions"] == 72  # nodes 0, 6, … 66: one step short of 72
    assert len(draft.missing) == 1


def test_frfs_of_a_structure_can_be_processed_as_drafted(tmp_path):
    path = SHARED / "real" / "ruler_grid" / "frf.uff"
    if not path.exists():
        pytest.skip("measured data are not at hand")
    shutil.copy(path, tmp_path)
    draft, content = drafted(tmp_path)
    assert draft.missing == ()
    assert {name for name, part in content.items() if part} == {"schema", "runs"}
    assert list(ema.read_campaign(tmp_path).frf.node) == list(range(1, 11))


@pytest.mark.parametrize(("force_node", "angle"), [(1, 10.0), (36, 0.0), (0, 0.0)])
def test_frfs_say_at_which_node_the_force_acts(tmp_path, force_node, angle):
    frf = systems.tyre_frf(positions=36)
    counted_from_1 = replace(frf, node=np.arange(1, 37))
    write_frfs(tmp_path / "frf.uff", counted_from_1, reference_node=force_node)
    draft, content = drafted(tmp_path)
    assert content["grid"]["positions"] == 36
    assert content["excitation"]["position_deg"] == angle
    assert ("# assumed" in draft.text) == (force_node == 0)


@pytest.mark.parametrize("name", ["REF", "aRef", "acc_ref", "accREF", "Referenz", "aReferenz"])
def test_the_fixed_sensor_is_known_by_its_name(tmp_path, name):
    for run in (1, 2):
        (tmp_path / f"run_{run}.csv").write_text(
            f"time [s];force [N];a1 [m/s^2];{name} [m/s^2]\n"
            + "".join(f"{k / 1000};{k * run % 7};{k % 5};{k % 3}\n" for k in range(64))
        )
    assert f'reference = "{name}"' in drafted(tmp_path)[0].text


def runs_of_four(folder, names="abcd"):
    for run in (2, 10):  # the second one comes last, as in the folder
        (folder / f"run_{run}.csv").write_text(
            ",".join(["time [s]", "force [N]", *(f"{name} [m/s^2]" for name in names)])
            + "".join(
                f"\n{k / 1000},{k * run % 7},{k % 5},{k % 3},{k % 11},{k % 13}" for k in range(64)
            )
        )


def test_evenly_spread_sensors_that_are_turned_need_no_typing(tmp_path):
    runs_of_four(tmp_path)
    draft = draft_manifest(tmp_path, layout=Layout(120.0, 15.0), reference="d")
    content = tomllib.loads(draft.text)
    assert content["grid"]["positions"] == 24
    assert [run["reference"] for run in content["runs"]] == ["d", "d"]
    first, second = (run["positions_deg"] for run in content["runs"])
    assert first == {"a": 0.0, "b": 120.0, "c": 240.0}
    assert second == {"a": 15.0, "b": 135.0, "c": 255.0}
    assert draft.missing == draft.missing[:1]  # pressure and radius


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"layout": Layout(120.0)}, "120° between 4 sensors"),
        ({"reference": "REF"}, "--reference: 'REF'; the recordings have a, b, c, d, force"),
    ],
)
def test_a_layout_that_does_not_fit_is_refused(tmp_path, options, says):
    runs_of_four(tmp_path)
    with pytest.raises(InputError, match=re.escape(says)):
        draft_manifest(tmp_path, **options)


def test_frfs_beside_time_series_stay_out(bare):
    path = SHARED / "real" / "ruler_grid" / "frf.uff"
    if not path.exists():
        pytest.skip("measured data are not at hand")
    shutil.copy(path, bare)
    draft, content = drafted(bare)
    assert len(content["runs"]) == 6
    assert '# FRFs, instead of the time series\n# [[runs]]\n# file = "frf.uff"' in draft.text
    assert len(with_data_of_the_tyre(bare).runs) == 6


def test_measured_sweeps_of_a_plate(tmp_path):
    folder = SHARED / "real" / "plate_sweep"
    if not folder.exists():
        pytest.skip("measured data are not at hand")
    for path in folder.glob("*.uff"):
        shutil.copy(path, tmp_path)
    _, content = drafted(tmp_path)
    assert content["acquisition"]["sampling_rate_hz"] == 25600.0
    assert content["excitation"]["channel"] == "force"
    assert len(content["runs"]) == 4


def test_a_file_whose_name_is_no_text(tmp_path):
    write(tmp_path, "a.parquet", ["force [N]", "A [g]"])
    try:
        shutil.copy(tmp_path / "a.parquet", tmp_path / "b\udce4.parquet")
    except (OSError, UnicodeError):
        pytest.skip("this file system takes no such names")
    draft, content = drafted(tmp_path)
    assert len(content["runs"]) == 1
    assert "rename the file" in draft.left_out[0]


@settings(max_examples=25)
@given(st.lists(st.text(min_size=1, max_size=8), min_size=1, max_size=4, unique=True))
def test_any_names_make_a_valid_manifest(tmp_path_factory, names):
    folder = tmp_path_factory.mktemp("names")
    labels = [f"{name.strip() or 'x'} [V]" for name in names]
    write(folder, "a.parquet", ["force [N]", *labels])
    drafted(folder)
    write(
        folder, "b.parquet", ["force [N]", *(label.replace("[V]", "30deg [g]") for label in labels)]
    )
    drafted(folder)


def test_geometry_beside_recordings_has_a_run(tmp_path):
    angles = 2 * np.pi * np.arange(4) / 4
    xyz = {k + 1: (np.cos(a), np.sin(a), 0.0) for k, a in enumerate(angles.tolist())}
    samples = b"".join(response58(n=64, name=f"A{node}", node=node) for node in xyz)
    (tmp_path / "run.uff").write_bytes(force58(n=64) + samples)
    (tmp_path / "places.uff").write_bytes(nodes15(xyz))
    write_draft(tmp_path, draft_manifest(tmp_path))
    campaign = ema.read_campaign(tmp_path)
    assert sorted(each.position_deg for each in campaign.runs[0].responses) == [0, 90, 180, 270]


def test_vibrometers_are_sensors(tmp_path):
    text = "time [s],F [N],V1 [mm/s],V2 [mm/s],T [V]\n0,1,2,3,4\n0.5,1,3,2,5\n"
    (tmp_path / "a.csv").write_text(text)
    assert "V1 = <deg>, V2 = <deg> }" in draft_manifest(tmp_path).text


def test_the_unit_of_frfs_is_asked_for(tmp_path):
    (tmp_path / "a.csv").write_text("f [Hz],H real,H imag\n" + "1,2,3\n2,3,4\n3,4,5\n")
    draft = draft_manifest(tmp_path)
    assert any("frf_unit" in each for each in draft.missing)
    text = draft.text.replace("# frf_unit", "frf_unit")
    assert "frf_unit" in tomllib.loads(text)["acquisition"]


def test_places_of_a_moved_force_are_left_to_the_files(tmp_path):
    for number, node in enumerate((3, 9)):
        channels = [response58(name=f"A{k}", node=k) for k in range(1, 13)]
        content = force58(node=node) + b"".join(channels)
        (tmp_path / f"{number}.uff").write_bytes(content)
    _, content = drafted(tmp_path)
    assert "position_deg" not in content["excitation"]
    runs = ema.read_campaign(tmp_path).runs
    assert [run.forces[0].node for run in runs] == [3, 9]
