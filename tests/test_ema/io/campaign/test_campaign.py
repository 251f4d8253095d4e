"""Campaigns: roles and places of channels, with and without a manifest."""

import re
import textwrap
import unicodedata

import numpy as np
import pytest
from builders import SHARED_DATA, binary58, floats, force58, frf58, nodes15, response58

import ema
from ema.checks.sensor_mass import masses_of_runs, sensors_of_runs
from ema.core.errors import InputError, ManifestError, RecordingFormatError
from ema.io.campaign.manifest import read_manifest

MANIFEST = """
schema = 1
[tyre]
designation = "225/55R17"
inflation_pressure_pa = 220000.0
serial = 4711
[acquisition]
sampling_rate_hz = 2000.0
[grid]
positions = 4
[excitation]
channel = "force"
position_deg = -90.0
[processing]
averages = 2
band_hz = [20, 260.0]
[[runs]]
file = "config_1.uff"
reference = "REF"
positions_deg = { A01 = 0.0, A02 = 180.0, REF = 2.5 }
[[runs]]
file = "config_2.uff"
reference = "REF"
positions_deg = { A01 = 90.0, A02 = 270.0, REF = 2.5 }
"""


def run_file(*, force=None, nodes=(1, 2), names=("A01", "A02"), reference="REF", **header):
    sensors = [
        response58(name=name, node=node, **header) for name, node in zip(names, nodes, strict=True)
    ]
    if reference:
        sensors.append(response58(name=reference, node=40, **header))
    return (force58(**header) if force is None else force) + b"".join(sensors)


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "campaign.toml").write_text(MANIFEST)
    (tmp_path / "config_1.uff").write_bytes(run_file())
    (tmp_path / "config_2.uff").write_bytes(run_file() + b"\n")  # one byte from a duplicate
    return tmp_path


def change(folder, old, new):
    assert old in MANIFEST
    (folder / "campaign.toml").write_text(MANIFEST.replace(old, new, 1))


@pytest.mark.parametrize(
    ("text", "window"), [("0.5", (0.5, 0.0)), ("{ value = 0.5, std = 0.02 }", (0.5, 0.02))]
)
def test_windows_of_the_analyser_are_declared(folder, text, window):
    declared = f"exponential_window_s = {text}\nforce_window_s = 0.01"
    change(folder, "averages = 2", declared)
    campaign = ema.read_campaign(folder)
    found = campaign.processing.exponential_window
    assert (found.time_constant_s, found.std_s) == window
    assert campaign.processing.force_window_s == 0.01


def test_manifest_gives_roles_and_places(folder):
    campaign = ema.read_campaign(folder)
    assert campaign.name == folder.name
    assert [run.name for run in campaign.runs] == ["config_1.uff", "config_2.uff"]
    assert [run.force.name for run in campaign.runs] == ["force", "force"]
    assert [run.reference.name for run in campaign.runs] == ["REF", "REF"]
    places = [[(each.node, each.position_deg) for each in run.responses] for run in campaign.runs]
    assert places == [[(0, 0.0), (2, 180.0)], [(1, 90.0), (3, 270.0)]]
    assert (campaign.positions, campaign.excitation_deg, campaign.reference_deg) == (4, 270.0, 2.5)
    assert campaign.tyre.details == {"serial": "4711"}
    assert campaign.tyre.inflation_pressure_pa == 220000.0
    assert campaign.processing.band_hz == (20.0, 260.0)
    assert [path.name for path in campaign.sources] == [
        "campaign.toml",
        "config_1.uff",
        "config_2.uff",
    ]
    assert campaign.findings == ()
    assert ema.read_campaign(str(folder / "campaign.toml")).sources == campaign.sources


def test_samples_stay_on_disk(folder):
    for channel in ema.read_campaign(folder).runs[0].recording.channels:
        assert isinstance(channel.samples, np.memmap)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("schema = 1", "", "schema: nothing"),
        ("schema = 1", "schema = 2", "schema: 2"),
        ("schema = 1", "schema = ", "TOML"),
        ("schema = 1", "schema = " + "[" * 5000, "TOML"),
        ("positions = 4", "position = 4", "Did you mean 'positions'"),
        ("positions = 4", 'positions = "4"', "grid.positions: '4'"),
        ("positions = 4", "positions = 2", "greater than or equal to 3"),
        ("[acquisition]", "[aquisition]", "Did you mean 'acquisition'"),
        ("serial", "mean_radius", "or mean_radius_m for SI"),
        ("220000.0", "-1.0", "tyre.inflation_pressure_pa: -1.0"),
        ("220000.0", "nan", "tyre.inflation_pressure_pa: nan"),
        ("220000.0", "2.2", "tyre.inflation_pressure_pa: 2.2; tyres have 1000"),
        ("serial = 4711", "mean_radius_m = 330", "tyre.mean_radius_m: 330; tyres have"),
        ("serial = 4711", "belt_width_m = 190", "tyre.belt_width_m: 190; tyres have"),
        ("[grid]", "[sensors]\nmass_kg = 4\n[grid]", "sensors.mass_kg: 4; sensors have up"),
        ("[grid]", "[sensors]\nmass_kg = { REF = 0.012 }\n[grid]", "no mass of A01, A02"),
        ("[grid]", "[sensors]\nmass_kg = { default = 0, RFE = 0.01 }\n[grid]", "mean 'REF'"),
        ("[grid]", "[sensors]\nmass_kg = { default = 0, REF = 12 }\n[grid]", "have up to 1 kg"),
        ("[20, 260.0]", "[260, 20]", "[lower, upper]"),
        ("averages = 2", "averages = 2\nblock_seconds = 4.0", "exclude each other"),
        ("averages = 2", "overlap = 1.0", "processing.overlap"),
        ("averages = 2", 'overlap = "half"', "processing.overlap"),
        ("averages = 2", "exponential_window_s = 0.0", "processing.exponential_window_s"),
        ("averages = 2", "force_window_s = -1.0", "processing.force_window_s"),
        ("2000.0", "2048.0", "config_1.uff was sampled at 2000 Hz"),
        ('"config_1.uff"', '"config_3.uff"', "Did you mean"),
        ('"config_1.uff"', '"config_2.uff"', "runs.2.file: 'config_2.uff'; run 1 names"),
        ('"config_1.uff"', '"../config_1.uff"', "stay within its folder"),
        ('"config_1.uff"', '"/etc/passwd"', "stay within its folder"),
        ('"config_1.uff"', '"a\\u0000.uff"', "stay within its folder"),
        ('"config_1.uff"', '"link.uff"', "stay within its folder"),
        ('file = "config_1.uff"', "", "runs.1.file"),
        ("A01 = 0.0", "A11 = 0.0", "Did you mean 'A01'"),
        ("A01 = 0.0", "A01 = 180.0", "'A01' and 'A02' are both at 180 degrees"),
        ("A01 = 0.0", "A01 = -180.0", "'A01' and 'A02' are both at 180 degrees"),
        ('"REF"', '"RFE"', "Did you mean 'REF'"),
        ('"REF"', '"force"', "cannot be the reference and the force"),
        ("REF = 2.5", "REF = 3.5", "earlier runs it is at 3.5"),
        ('channel = "force"', 'channel = "Force"', "Did you mean 'force'"),
        ('channel = "force"', 'channel = "A01"', "its role needs force"),
        ("A01 = 0.0, A02 = 180.0, ", "", "at least one response"),
    ],
)
def test_faults_of_a_manifest_are_named(folder, old, new, message):
    (folder / "link.uff").symlink_to("/etc/hostname")
    change(folder, old, new)
    with pytest.raises(ManifestError, match=re.escape(message)) as caught:
        ema.read_campaign(folder)
    assert caught.value.where.startswith("campaign.toml")


def test_each_sensor_may_have_a_mass_of_its_own(folder):
    change(folder, "[grid]", "[sensors]\nmass_kg = { default = 0.004, REF = 0.012 }\n[grid]")
    campaign = ema.read_campaign(folder)
    assert [campaign.mass_of(name) for name in ("A01", "REF")] == [0.004, 0.012]
    masses = masses_of_runs(campaign)["config_1.uff"]
    np.testing.assert_array_equal(masses, [0.004, 0.004, 0.012])
    assert masses.size == sensors_of_runs(campaign)["config_1.uff"].size


@pytest.mark.parametrize(("stored", "written"), [("NFC", "NFD"), ("NFD", "NFC")])
def test_an_umlaut_may_be_one_character_or_two(folder, stored, written):
    (folder / "config_1.uff").rename(folder / unicodedata.normalize(stored, "Prüfung.uff"))
    change(folder, '"config_1.uff"', f'"{unicodedata.normalize(written, "Prüfung.uff")}"')
    assert len(ema.read_campaign(folder).runs) == 2


def test_a_name_that_looks_the_same_leads_out_of_the_folder_no_more_than_any(folder):
    (folder / unicodedata.normalize("NFD", "ü.uff")).symlink_to("/etc/hostname")
    change(folder, '"config_1.uff"', f'"{unicodedata.normalize("NFC", "ü.uff")}"')
    with pytest.raises(ManifestError, match="stay within its folder"):
        ema.read_campaign(folder)


def test_a_manifest_of_another_encoding_is_named_with_its_line(folder):
    text = MANIFEST.replace("225/55R17", "Prüfreifen")
    (folder / "campaign.toml").write_bytes(text.encode("latin-1"))
    with pytest.raises(ManifestError, match=r"campaign.toml, line 4: byte 0xfc; .*Save it in UTF"):
        ema.read_campaign(folder)


@pytest.mark.parametrize(
    ("old", "new", "check", "detail"),
    [
        ("A01 = 0.0, ", "", "ignored", "positions_deg"),
        ("A01 = 0.0, ", "", "grid", "1 of 4 grid positions not measured: 0 degrees"),
        ("A01 = 0.0", "A01 = 1.0", "grid", "1 degrees: none of the 4 grid positions"),
        ("[grid]\npositions = 4", "", "grid", "positions_deg without [grid]"),
    ],
)
def test_what_is_only_poorer_is_recorded(folder, old, new, check, detail):
    change(folder, old, new)
    found = [(each.check, each.detail) for each in ema.read_campaign(folder).findings]
    assert any(each == check and detail in text for each, text in found)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "the file is empty"),
        (run_file()[:-100], "truncated"),
        (run_file(names=("A01", "A01")), "both called 'A01'"),
        (run_file(step="  1.00000E-04"), "sampled at 10000 Hz"),
        (frf58(np.ones(4))[:-50], "truncated"),
    ],
)
def test_damaged_runs_stop_a_campaign(folder, content, message):
    (folder / "config_2.uff").write_bytes(content)
    with pytest.raises(InputError, match=re.escape(message)):
        ema.read_campaign(folder)


@pytest.mark.parametrize("axis", [(12, 0, 0, "x", "V"), (15, 0, 0, "", "Pa")])
def test_responses_must_be_motions(folder, axis):
    content = force58() + response58() + response58(name="A02", axis=axis) + response58(name="REF")
    (folder / "config_1.uff").write_bytes(content)
    with pytest.raises(ManifestError, match="its role needs acceleration"):
        ema.read_campaign(folder)


def by_node(folder, nodes_1, nodes_2):
    text = re.sub(r"positions_deg = .*\n", "", MANIFEST).replace("position_deg = -90.0", "")
    (folder / "campaign.toml").write_text(text)
    (folder / "config_1.uff").write_bytes(run_file(nodes=nodes_1))
    (folder / "config_2.uff").write_bytes(run_file(nodes=nodes_2))
    return ema.read_campaign(folder)


def test_nodes_give_places_on_the_grid(folder):
    campaign = by_node(folder, (4, 2), (1, 3))
    places = [each.position_deg for run in campaign.runs for each in run.responses]
    assert places == [0.0, 180.0, 90.0, 270.0]
    assert campaign.excitation_deg == 0.0
    assert campaign.reference_deg is None


def test_nodes_beyond_the_grid_have_no_place(folder):
    with pytest.raises(ManifestError, match=r"'A02' \(node 5\) in config_1.uff"):
        by_node(folder, (0, 5), (1, 3))


def test_without_nodes_a_grid_needs_positions(folder):
    zero = force58() + response58(node=0) + response58(node=0, name="REF")
    text = re.sub(r"positions_deg = .*\n", "", MANIFEST)
    (folder / "campaign.toml").write_text(text)
    for number in (1, 2):
        (folder / f"config_{number}.uff").write_bytes(zero + b"\n" * number)
    with pytest.raises(ManifestError, match="no position of 'A01'"):
        ema.read_campaign(folder)


def test_geometry_overrides_the_grid_and_positions_override_geometry(folder):
    turned = nodes15({node: (np.sin(a), np.cos(a), 0) for node, a in ((1, 0.0), (2, np.pi / 2))})
    (folder / "config_1.uff").write_bytes(turned + run_file())
    campaign = ema.read_campaign(folder)
    assert [each.position_deg for each in campaign.runs[0].responses] == [0.0, 180.0]
    text = MANIFEST.replace("positions_deg = { A01 = 0.0, A02 = 180.0, REF = 2.5 }\n", "")
    (folder / "campaign.toml").write_text(text)
    run = ema.read_campaign(folder).runs[0]
    angles = [each.position_deg for each in run.responses]
    assert angles == pytest.approx([90.0, 0.0], abs=1e-4)


def test_a_table_takes_its_rate_and_units_from_the_manifest(tmp_path):
    (tmp_path / "a.csv").write_text("force,A01\n1,2\n3,4\n")
    (tmp_path / "campaign.toml").write_text(
        textwrap.dedent("""
        schema = 1
        acquisition.sampling_rate_hz = 500
        excitation.channel = "force"
        [[runs]]
        file = "a.csv"
        positions_deg = { A01 = 0 }
        """)
    )
    campaign = ema.read_campaign(tmp_path)
    run = campaign.runs[0]
    assert run.recording.sampling_rate_hz == 500.0
    assert (run.responses[0].channel.quantity, run.responses[0].node) == ("acceleration", 1)
    assert not campaign.has_circle
    details = [each.detail for each in campaign.findings]
    assert sum("no unit stated" in detail for detail in details) == 2


def test_recordings_without_a_manifest(tmp_path):
    for number in (10, 2):
        content = run_file(reference=None) + b"\n" * number
        (tmp_path / f"run_{number}.uff").write_bytes(content)
    campaign = ema.read_campaign(tmp_path)
    assert [run.name for run in campaign.runs] == ["run_2.uff", "run_10.uff"]
    for run in campaign.runs:
        assert [(each.node, each.position_deg) for each in run.responses] == [(1, None), (2, None)]
        assert run.reference is None
    listed = ema.read_campaign([tmp_path / "run_10.uff", str(tmp_path / "run_2.uff")])
    assert [path.name for path in listed.sources] == ["run_10.uff", "run_2.uff"]
    assert ema.read_campaign(tmp_path / "run_2.uff").name == "run_2"


def test_channels_without_nodes_are_numbered_by_name(tmp_path):
    for number, names in ((1, ("A", "B")), (2, ("B", "C"))):
        content = run_file(names=names, nodes=(0, 0), reference=None)
        (tmp_path / f"{number}.uff").write_bytes(content)
    campaign = ema.read_campaign(tmp_path)
    nodes = [[each.node for each in run.responses] for run in campaign.runs]
    assert nodes == [[1, 2], [2, 3]]
    assert {each.check for each in campaign.findings} == {"node"}


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (response58(), "no force among channels A01 (acceleration)"),
        (force58() + force58(name="F2") + response58(), "2 forces: force, F2"),
        (force58(), "at least one response"),
        (force58() + response58(name="a") + response58(name="b"), "'a' and 'b' are both at node 1"),
        (frf58(np.ones(4), function_type=9), "no usable datasets"),
    ],
)
def test_what_is_missing_without_a_manifest(tmp_path, content, message):
    (tmp_path / "a.uff").write_bytes(content)
    with pytest.raises(RecordingFormatError, match=re.escape(message)) as caught:
        ema.read_campaign(tmp_path / "a.uff")
    if "force" in message[:12]:
        assert "`ringmodal init FOLDER`" in caught.value.remedy


def test_sources_that_hold_nothing(tmp_path):
    with pytest.raises(RecordingFormatError, match="no recordings"):
        ema.read_campaign(tmp_path)
    with pytest.raises(RecordingFormatError, match="no files"):
        ema.read_campaign([])
    with pytest.raises(RecordingFormatError, match="not found"):
        ema.read_campaign(tmp_path / "a.uff")
    with pytest.raises(ManifestError, match="No such file"):
        ema.read_campaign(tmp_path / "campaign.toml")
    (tmp_path / "a.csv").write_text("force [N],a [g]\n1,2\n")
    with pytest.raises(RecordingFormatError, match="no sampling rate"):
        ema.read_campaign(tmp_path)


def test_frfs_of_several_files_become_one_set(tmp_path):
    values = np.array([1 + 1j, 2, 3])
    (tmp_path / "a.uff").write_bytes(frf58(values, node=1) + frf58(2 * values, node=2))
    (tmp_path / "b.uff").write_bytes(frf58(3 * values, node=3))
    frf = ema.read_campaign(tmp_path).frf
    np.testing.assert_array_equal(frf.values, [values, 2 * values, 3 * values])
    assert frf.run == ("a.uff", "a.uff", "b.uff")
    assert frf.node.tolist() == [1, 2, 3]
    (tmp_path / "b.uff").write_bytes(frf58(values, node=3, step="  2.00000E+00"))
    with pytest.raises(RecordingFormatError, match="3 lines to 4 Hz"):
        ema.read_campaign(tmp_path)


def test_frfs_on_a_grid(tmp_path):
    content = frf58(np.ones(3), node=1) + frf58(np.ones(3), node=3, name="A02")
    (tmp_path / "a.uff").write_bytes(content)
    manifest = "schema = 1\ngrid.positions = 4\nruns = [{ file = 'a.uff'POSITIONS }]"
    (tmp_path / "campaign.toml").write_text(manifest.replace("POSITIONS", ""))
    assert ema.read_campaign(tmp_path).frf.position_deg.tolist() == [90.0, 270.0]
    named = ", positions_deg = { A01 = 180.0 }"
    (tmp_path / "campaign.toml").write_text(manifest.replace("POSITIONS", named))
    frf = ema.read_campaign(tmp_path).frf
    assert frf.position_deg.tolist() == [180.0, 270.0]
    assert frf.node.tolist() == [2, 3]


def test_frfs_without_nodes_are_numbered(tmp_path):
    content = frf58(np.ones(3), node=0) + frf58(np.ones(3), node=0)
    (tmp_path / "a.uff").write_bytes(content)
    assert ema.read_campaign(tmp_path).frf.node.tolist() == [1, 2]


def test_frfs_win_over_time_series(tmp_path):
    (tmp_path / "a.uff").write_bytes(run_file() + frf58(np.ones(3)))
    campaign = ema.read_campaign(tmp_path)
    assert campaign.runs == ()
    assert [each.verdict for each in campaign.findings] == ["excluded"]


def test_signs_reach_the_samples(tmp_path):
    values = floats(range(8))
    content = force58() + binary58(values, direction=-3, axis=(12, 0, 0, "a", "g"))
    (tmp_path / "a.uff").write_bytes(content)
    run = ema.read_campaign(tmp_path / "a.uff").runs[0]
    np.testing.assert_allclose(run.responses[0].channel.block(0, 8), -9.80665 * np.arange(8))


@pytest.mark.skipif(not SHARED_DATA.exists(), reason="measured data of others are not at hand")
def test_measured_campaigns():
    sweep = ema.read_campaign(SHARED_DATA / "real" / "plate_sweep")
    assert [run.force.name for run in sweep.runs] == ["force"] * 4
    assert {run.recording.sampling_rate_hz for run in sweep.runs} == {25600.0}
    assert [each.node for run in sweep.runs for each in run.responses] == [1, 1, 1, 1]
    ruler = ema.read_campaign(SHARED_DATA / "real" / "ruler_grid" / "frf.uff")
    assert ruler.frf.values.shape == (10, 3276)
    assert not ruler.has_circle


def test_values_of_a_manifest_may_have_units(tmp_path):
    text = CAMPAIGN_TEXT
    path = tmp_path / "campaign.toml"
    path.write_text(text, encoding="utf-8")
    manifest = read_manifest(path)
    assert manifest.tyre.inflation_pressure_pa == pytest.approx(240000.0)
    assert manifest.tyre.mean_radius_m == pytest.approx(0.33)
    assert manifest.sensors.own_kg == {"REF": pytest.approx(0.012)}
    assert manifest.processing.exponential_window_s == pytest.approx(0.5)


CAMPAIGN_TEXT = """\
schema = 1
[tyre]
inflation_pressure = "2,4 bar"
mean_radius = "330 mm"
[sensors]
mass = { default = "4 g", REF = "12 g" }
[processing]
exponential_window = "500 ms"
[[runs]]
file = "a.uff"
"""


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ('inflation_pressure = "2.4 barg"', "Pa, hPa, kPa, MPa, bar"),
        ("inflation_pressure = 2.4\n", "inflation_pressure_pa for SI"),
        ('inflation_pressure = "2 bar"\ninflation_pressure_pa = 2e5', "the same"),
    ],
)
def test_units_that_cannot_be_are_named(tmp_path, line, says):
    path = tmp_path / "campaign.toml"
    path.write_text(CAMPAIGN_TEXT.replace('inflation_pressure = "2,4 bar"', line), encoding="utf-8")
    with pytest.raises(ManifestError, match=says):
        read_manifest(path)
