"""Parameter sets: what is written is read, and what is wrong is named."""

from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ema.core.errors import InputError
from model.damping import identify_damping
from model.parameters import (
    TABLE_3_DAMPING_RATIOS,
    TABLE_3_FREQUENCIES_HZ,
    TABLE_3_ORDERS,
    TABLE_4_RING,
    TABLE_5_DAMPING,
    Wheel,
)
from model.tuning import tune_ring
from model.verdict import Evidence, Reason, RingVerdict, State
from pipelines.results.parameter_set import (
    DAMPING_NAMES,
    RING_NAMES,
    Parameter,
    ParameterSet,
    from_tuning,
    read_parameter_set,
    write_parameter_set,
)
from pipelines.results.verdict import Basis, Covariance

PAPER = Path(__file__).parents[3] / "sample_data" / "tyre_225_55R17.toml"
# As the contract prints it.
PRINTED = """schema = 1
designation = "225/55R17"

[conditions]
inflation_pressure_pa = 220000.0

[ring]                                # each: value, std, how
mean_radius_m = { value = 0.33, how = "given" }
belt_width_m = { value = 0.19, how = "given" }
mass_per_area_kg_m2 = { value = 19.69, how = "given" }
radial_stiffness_n_m3 = { value = 8.27e6, how = "identified", std = 8.0e4 }
circumferential_stiffness_n_m3 = { value = 6.56e5, how = "identified", std = 1.4e5 }
axial_stiffness_n_m = { value = 2.52e7, how = "not identified" }
bending_stiffness_n_m = { value = 7.45, how = "identified", std = 1.8 }

[damping]
radial_n_s_m3 = { value = 1900.0, how = "given" }
circumferential_n_s_m3 = { value = 1500.0, how = "given" }
loss_factor = { value = 0.025, how = "given" }

[wheel]                               # optional
mass_kg = 12.0
inertia_kg_m2 = 0.6

[provenance]
"""


@pytest.fixture
def path(tmp_path):
    return tmp_path / "tyre.toml"


def written(path, text):
    path.write_text(text, encoding="utf-8")
    return path


def test_the_printed_example_is_read(path):
    parameters = read_parameter_set(written(path, PRINTED))
    assert parameters.designation == "225/55R17"
    assert parameters.ring["radial_stiffness_n_m3"] == Parameter(8.27e6, "identified", 8e4)
    assert parameters.ring["mean_radius_m"].std is None
    assert parameters.ring_parameters == TABLE_4_RING
    assert parameters.ring_damping == TABLE_5_DAMPING
    assert parameters.wheel_parameters == Wheel(12.0, 0.6)


def test_the_papers_tyre_comes_with_the_package_sources():
    parameters = read_parameter_set(PAPER)
    assert parameters.ring_parameters == TABLE_4_RING
    assert parameters.ring_damping == TABLE_5_DAMPING
    assert parameters.wheel_parameters is None


def test_a_tuned_ring_comes_back_with_its_error_bars(path):
    tuning = tune_ring(
        TABLE_3_ORDERS,
        TABLE_3_FREQUENCIES_HZ,
        mean_radius_m=0.33,
        inflation_pressure_pa=2.2e5,
        belt_width_m=0.19,
    )
    damping = identify_damping(tuning.ring, TABLE_3_ORDERS, TABLE_3_DAMPING_RATIOS)
    made = from_tuning("225/55R17", tuning, damping, {"software": "ringmodal"})
    write_parameter_set(path, made)
    read = read_parameter_set(path)
    assert read == made
    assert read.ring_parameters == tuning.ring
    assert read.ring_damping == damping.damping
    for name, parameter in read.ring.items():
        assert parameter.how == tuning.how[name]


def test_no_belt_width_is_no_belt_width(path):
    tuning = tune_ring(
        TABLE_3_ORDERS, TABLE_3_FREQUENCIES_HZ, mean_radius_m=0.33, inflation_pressure_pa=2.2e5
    )
    write_parameter_set(path, from_tuning("tyre", tuning, None, {}))
    read = read_parameter_set(path)
    assert "belt_width_m" not in read.ring
    assert read.ring_parameters.belt_width_m is None
    assert read.ring_damping is None


def based(**changes):
    rim = Evidence(Reason.RIM, "two modes of order 1: 79 and 95 Hz", 1)
    verdict = RingVerdict((rim, Evidence(Reason.ORDER, "order 4")), 9.5, 2, (1, 2, 3), (4,))
    covariance = Covariance(("mean_radius_m", "loss_factor"), ((1.0, 0.5), (0.5, 2.0)))
    return replace(Basis("follower", verdict, ("hum: 50 Hz",), covariance), **changes)


@pytest.mark.parametrize(
    "basis", [Basis(), based(), based(verdict=None, warnings=()), based(covariance=None)]
)
def test_what_a_set_rests_on_comes_back(path, basis):
    made = replace(read_parameter_set(PAPER), basis=basis)
    write_parameter_set(path, made)
    assert read_parameter_set(path) == made


def test_the_worst_reason_is_the_state():
    assert based().state is State.BAD
    assert RingVerdict((), None, 0, (1,)).state is State.GOOD


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('"follower"', '"gas"'),
        ('state = "bad"', 'state = "good"'),
        ('"rim moves"', '"rim rests"'),
        ("[[1.0, 0.5]", "[[1.0]"),
        ("[[1.0, 0.5]", "[[nan, 0.5]"),
        ('"loss_factor"]', '"gain"]'),
    ],
)
def test_an_edited_basis_is_refused(path, old, new):
    write_parameter_set(path, replace(read_parameter_set(PAPER), basis=based(), provenance={}))
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(InputError, match="must be"):
        read_parameter_set(path)


VALUES = st.floats(1e-12, 10.0)
HOW = st.sampled_from(["given", "identified", "not identified", "at bound"])
PARAMETERS = st.builds(Parameter, VALUES, HOW, st.none() | VALUES)


@given(
    ring=st.fixed_dictionaries(dict.fromkeys(RING_NAMES, PARAMETERS)),
    damping=st.fixed_dictionaries(dict.fromkeys(DAMPING_NAMES, PARAMETERS)),
    designation=st.text(st.characters(exclude_categories=["Cs", "Cc"]), max_size=20),
    pressure=VALUES,
)
def test_every_set_comes_back_to_the_last_digit(
    tmp_path_factory, ring, damping, designation, pressure
):
    path = tmp_path_factory.mktemp("sets") / "tyre.toml"
    conditions = {"inflation_pressure_pa": pressure, "rim": "7J×17"}
    made = ParameterSet(
        designation,
        conditions,
        ring,
        damping,
        {"mass_kg": 12.0, "inertia_kg_m2": 0.6},
        {"note": "a"},
    )
    write_parameter_set(path, made)
    assert read_parameter_set(path) == made


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("[ring] ", "[rang] ", r"no section \[ring\]"),
        ("[conditions]", "[condition]", r"no section \[conditions\]"),
        ("inflation_pressure_pa = 220000.0", "", "no inflation_pressure_pa"),
        ("mean_radius_m = {", "mean_radius_mm = {", "unknown key 'mean_radius_mm'"),
        ("bending_stiffness_n_m = { value = 7.45", "#", "no bending_stiffness_n_m"),
        ("value = 19.69", 'value = "heavy"', r"\[ring\] mass_per_area_kg_m2"),
        ("value = 19.69", "value = true", "mass_per_area_kg_m2"),
        ("std = 1.8", 'std = "small"', "bending_stiffness_n_m"),
        ("loss_factor =", "loss =", "unknown key 'loss'"),
        ("= 220000.0", '= "high"', r"\[conditions\] inflation_pressure_pa: 'high'"),
        ("mass_kg = 12.0", "mass = 12.0", r"\[wheel\]: unknown key 'mass'"),
        ("mass_kg = 12.0", "", r"\[wheel\]: no mass_kg"),
        ("mass_kg = 12.0", "mass_kg = [12.0]", r"\[wheel\] mass_kg"),
        ("schema = 1", "schema = ", "TOML"),
        ("= 220000.0", f"= {'1' * 5000}", "TOML"),
        ("= 220000.0", f"= 1{'0' * 400}", "inflation_pressure_pa"),
        ("value = 19.69", f"value = 1{'0' * 400}", "mass_per_area_kg_m2"),
        ("std = 1.8", "std = -1.8", r"\[ring\] bending_stiffness_n_m: std = -1.8"),
        ("std = 1.8", "std = nan", "std = nan"),
        ('"identified", std = 1.8', '"identifed"', r"how = 'identifed'.*'identified'"),
        ('"identified", std = 1.8', "3", r"how = 3.*given, identified"),
        ("= 220000.0", "= 220000.0\ntemperature_c = 'warm'", r"temperature_c: 'warm'"),
        ("= 220000.0", "= 220000.0\nload_n = nan", r"\[conditions\] load_n: nan"),
        ('= "225/55R17"', "= 225", "designation: 225"),
        ("schema = 1", "schema = 1\nversion = 7", "version: 7"),
        ("[damping]", "[dampng]", r"\[dampng\].*\[damping\]"),
    ],
)
def test_faults_are_named_with_their_place(path, old, new, says):
    assert old in PRINTED
    with pytest.raises(InputError, match=says) as caught:
        read_parameter_set(written(path, PRINTED.replace(old, new)))
    assert "tyre.toml" in str(caught.value)


def test_a_set_of_another_schema_is_refused(path):
    with pytest.raises(InputError, match="schema"):
        read_parameter_set(written(path, PRINTED.replace("schema = 1", "schema = 2")))


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match=r"nowhere\.toml"):
        read_parameter_set(tmp_path / "nowhere.toml")


def test_a_file_that_is_no_text_is_refused(path):
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="UTF-8"):
        read_parameter_set(path)


@pytest.mark.parametrize("value", ["nan", "inf", "-1.0"])
def test_values_that_no_ring_can_have_are_refused(path, value):
    text = PRINTED.replace("value = 19.69", f"value = {value}")
    with pytest.raises(ValueError, match="mass_per_area_kg_m2"):
        _ = read_parameter_set(written(path, text)).ring_parameters


@pytest.mark.parametrize("value", ["1e308", "-1e300", "1e16", "1e-300"])
@pytest.mark.parametrize(
    ("section", "name"),
    [
        ("ring", "circumferential_stiffness_n_m3"),
        ("ring", "mean_radius_m"),
        ("damping", "loss_factor"),
        ("conditions", "inflation_pressure_pa"),
        ("wheel", "mass_kg"),
    ],
)
def test_a_size_that_no_tyre_has_is_refused(tmp_path, section, name, value):
    path = tmp_path / "tyre.toml"
    lines = PRINTED.splitlines()
    begin = next(k for k, line in enumerate(lines) if line.startswith(f"[{section}]"))
    at = next(k for k in range(begin, len(lines)) if lines[k].startswith(name))
    lines[at] = f"{name} = {value}"
    path.write_text("\n".join(lines))
    with pytest.raises(InputError) as refused:
        read_parameter_set(path)
    assert refused.value.where == f"tyre.toml, [{section}] {name}"
