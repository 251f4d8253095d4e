"""Help, versions, completion, and what is suggested for a slip."""

import re
import shlex
import subprocess
import sys

import pytest
import typer

from ema.poles.stability import METHODS
from model.tuning_problem import OBJECTIVES
from pipelines.cli import app as cli
from pipelines.cli import options as cli_options
from pipelines.cli.options import choice, ring_parameters

COMMANDS = (
    *("demo", "doctor", "inspect", "init", "process", "refit", "tune", "report", "review"),
    *("compare", "export", "simulate", "paper", "batch", "tyre"),
)


@pytest.fixture
def screen(monkeypatch):
    """Set the width of the terminal."""
    for name in ("NO_COLOR", "FORCE_COLOR"):
        monkeypatch.delenv(name, raising=False)

    def as_wide_as(columns):
        monkeypatch.setenv("COLUMNS", str(columns))

    return as_wide_as


def test_help_lists_the_commands_in_groups(ringmodal, screen):
    screen(80)
    code, output, _ = ringmodal("--help")
    assert code == 0
    assert re.findall(r"^([A-Z].*):$", output, re.MULTILINE) == [
        "First steps",
        "From recordings to a result",
        "Many campaigns",
        "Ring model",
        "Parameter sets",
        "General",
    ]
    assert set(re.findall(r"^  ([a-z]+)  ", output, re.MULTILINE)) == set(COMMANDS)


def test_options_of_process_are_in_groups(ringmodal, screen):
    screen(80)
    _, output, _ = ringmodal("process", "--help")
    assert re.findall(r"^([A-Z][a-z ]+):$", output, re.MULTILINE) == [
        *("Arguments", "Input and output", "Processing", "Poles", "Ring", "Screen", "General")
    ]


@pytest.mark.parametrize("columns", [60, 80, 120])
def test_help_keeps_within_the_screen_and_cuts_nothing(ringmodal, screen, columns):
    screen(columns)
    _, output, _ = ringmodal("process", "--help")
    texts = [line for line in output.splitlines() if not line.startswith("    ringmodal")]
    assert max(map(len, texts)) <= columns
    words = " ".join(output.split())
    assert "such as mass_per_area_kg_m2=19.7;" in words
    assert "…]" not in words.replace("HZ,HZ,…", "")


def test_every_command_has_an_example_that_is_taken(ringmodal):
    """Each line of the examples is a whole command with options that exist."""
    group = typer.main.get_command(cli.app)
    for name in COMMANDS:
        if name in ("simulate", "tyre"):
            continue
        _, output, _ = ringmodal(name, "--help")
        examples = re.findall(r"^ +ringmodal (.+)$", output, re.MULTILINE)
        assert examples
        for example in examples:
            command, *arguments = shlex.split(example)
            assert command == name
            group.get_command(None, name).make_context(name, arguments)


def test_help_loads_neither_numbers_nor_tables():
    """So that it is there at once."""
    heavy = ("numpy", "scipy", "pandas", "pyarrow", "matplotlib", "jinja2", "pydantic", "rich")
    program = (
        "import sys; sys.argv = ['ringmodal', '--help']\n"
        "from pipelines.cli.main import main\n"
        "try: main()\n"
        f"finally: print('loaded', [name for name in {heavy} if name in sys.modules])"
    )
    finished = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False
    )
    assert "Modal analysis of tyres" in finished.stdout
    assert finished.stdout.splitlines()[-1] == "loaded []"


def test_version_names_the_main_libraries(ringmodal):
    code, output, _ = ringmodal("--version")
    assert code == 0
    assert output.startswith("ringmodal ")
    for name in ("python", "numpy", "scipy", "pandas", "pyarrow", "matplotlib", "pyuff"):
        assert re.search(rf"^  {name} \d+\.\d+", output, re.MULTILINE)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["prcess"], "Did you mean 'process'?"),
        (["process", "--windw", "hann"], "--window"),
        (["--vesrion"], "--version"),
        (["simulate", "inertanc"], "Did you mean 'inertance'?"),
        (["simulate", "hub", "a/tyre.toml"], "a/tyre.toml"),
        (["simulate", "frequencies", "--frame", "rotatng"], "'rotating', 'absolute'"),
        (["process", "x", "--out", "y", "--method", "pslcf"], "Did you mean 'plscf'?"),
        (["process", "x", "--out", "y", "--objective", "freqency"], "Did you mean 'frequency'?"),
        (
            ["process", "x", "--out", "y", "--given", "mass_per_area=19"],
            "Did you mean 'mass_per_area_kg_m2'?",
        ),
    ],
)
def test_a_slip_gets_a_suggestion(ringmodal, arguments, says):
    code, output, errors = ringmodal(*arguments)
    assert (code, output) == (2, "")
    assert says in errors


@pytest.mark.parametrize(
    ("option", "value", "says"),
    [("--averages", "two", "integer"), ("--averages", "0", "1"), ("--block-seconds", "4s", "")],
)
def test_a_value_that_is_none_is_named(ringmodal, option, value, says):
    code, _, errors = ringmodal("process", "x", "--out", "y", option, value)
    assert code == 2
    assert f"Invalid value for '{option}': " in errors
    assert value in errors.splitlines()[-1]
    assert says in errors.splitlines()[-1]


def test_a_name_like_no_other_gets_none(ringmodal):
    code, _, errors = ringmodal("process", "--qqq")
    assert code == 2
    assert errors.splitlines()[-1] == "Error: No such option: --qqq"


@pytest.mark.parametrize(
    ("path", "says"), [("campain", "Did you mean {}?"), ("nowhere", "Check the name.")]
)
def test_a_folder_that_is_not_there(ringmodal, campaign_copy, tmp_path, path, says):
    code, _, errors = ringmodal("process", tmp_path / path, "--out", tmp_path / "r", "--quiet")
    assert code == 2
    assert says.format(campaign_copy) in errors


def test_known_values_are_taken_in_any_case():
    assert choice("--estimator", "hv", cli_options.ESTIMATORS) == "Hv"
    assert choice("--method", "LSCE", cli_options.METHODS) == "lsce"


def test_known_values_are_those_of_the_methods():
    assert METHODS == cli_options.METHODS
    assert tuple(OBJECTIVES) == cli_options.OBJECTIVES


def test_given_parameters_are_numbers_by_name():
    texts = ["mass_per_area_kg_m2=19.7", "bending_stiffness_n_m = 7"]
    expected = {"mass_per_area_kg_m2": 19.7, "bending_stiffness_n_m": 7.0}
    assert ring_parameters("--given", texts) == expected


@pytest.mark.parametrize(
    ("line", "offers"),
    [
        ("ringmodal pro", ["process"]),
        ("ringmodal process --estimator ", ["H1", "H2", "Hv"]),
        ("ringmodal process --method p", ["plscf"]),
        ("ringmodal process --window bl", ["blackman", "blackmanharris"]),
        ("ringmodal tune result --objective ", ["frequency", "paper"]),
        ("ringmodal tune result --given be", ["bending_stiffness_n_m="]),
        ("ringmodal simulate hub --hub ", ["fixed", "free"]),
    ],
)
def test_the_shell_completes(ringmodal, monkeypatch, line, offers):
    monkeypatch.setenv("_RINGMODAL_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", line)
    monkeypatch.setenv("COMP_CWORD", str(line.count(" ")))
    code, output, _ = ringmodal()
    assert code == 0
    assert output.split() == offers
