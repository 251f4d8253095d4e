"""A dead standard output or error costs no result and is no internal error."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from fleets import write_campaign

from pipelines.cli import streams
from pipelines.results.store import MARKER

ROOT = Path(streams.__file__).parents[2]
no_full_device = pytest.mark.skipif(
    not Path("/dev/full").is_char_device(), reason="the system has no full device"
)
pytestmark = pytest.mark.skipif(os.name != "posix", reason="streams are closed by a shell")

QUICK = ("--no-tune", "--max-order", "20")
DEAD = {
    "stdout closed": ">&-",
    "stderr closed": "2>&-",
    "both closed": ">&- 2>&-",
    "all closed": "<&- >&- 2>&-",
    "stdout read by nobody": "| true",
    "stderr read by nobody": "2>&1 >/dev/null | true",
    "both read by nobody": "2>&1 | true",
}


def shell(arguments, redirection="", folder=None, **extra):
    """Run the command in a shell; exit code of the command itself, output, errors."""
    paths = os.pathsep.join([str(ROOT), *sys.path])
    environment = {**os.environ, "PYTHONPATH": paths, "OMP_NUM_THREADS": "1", **extra}
    code = folder / "code"
    script = f'{{ "$0" -m pipelines.cli.main "$@"; echo $? >"{code}"; }} {redirection}'
    finished = subprocess.run(
        ["bash", "-c", script, sys.executable, *map(str, arguments)],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    return int(code.read_text()), finished.stdout, finished.stderr


@pytest.fixture(scope="module")
def campaign(short_campaign, tmp_path_factory):
    """One run, not to be changed: who listens does not depend on how much there is to process."""
    return write_campaign(short_campaign, tmp_path_factory.mktemp("quick") / "campaign")


@pytest.mark.parametrize("redirection", DEAD.values(), ids=DEAD.keys())
def test_a_result_is_written_whoever_listens(campaign, tmp_path, redirection):
    out = tmp_path / "result"
    arguments = ["process", campaign, "--out", out, "--no-report", *QUICK]
    code, output, errors = shell(arguments, redirection, tmp_path)
    assert code == 0
    assert (out / MARKER).is_file()
    assert "Traceback" not in output + errors
    assert "Exception ignored" not in output + errors


@pytest.mark.parametrize("name", ["stdout closed", "both closed", "both read by nobody"])
@pytest.mark.parametrize("options", [["--json"], []])
def test_what_is_only_printed_ends_quietly(campaign, tmp_path, name, options):
    redirection = DEAD[name]
    code, output, errors = shell(["inspect", campaign, *options], redirection, tmp_path)
    assert code == 0
    assert "Traceback" not in output + errors
    assert "Exception ignored" not in output + errors


@pytest.mark.parametrize("arguments", [["--help"], ["process"]])
def test_help_and_usage_errors_do_too(tmp_path, arguments):
    expected, _, _ = shell(arguments, "", tmp_path)
    for name in ("all closed", "both read by nobody"):
        code, output, errors = shell(arguments, DEAD[name], tmp_path)
        assert code == expected
        assert "Traceback" not in output + errors


@no_full_device
@pytest.mark.parametrize("options", [["--json"], []])
def test_a_full_drive_beneath_standard_output_is_an_error(campaign, tmp_path, options):
    code, _, errors = shell(["inspect", campaign, *options], ">/dev/full", tmp_path)
    assert code == 2
    assert len(errors.splitlines()) == 1


@no_full_device
def test_a_full_drive_beneath_both_leaves_the_exit_code(tmp_path):
    code, _, _ = shell(["inspect", tmp_path / "no.uff"], ">/dev/full 2>/dev/full", tmp_path)
    assert code == 2


@no_full_device
def test_a_full_drive_beneath_the_output_costs_no_result(campaign, tmp_path):
    out = tmp_path / "result"
    arguments = ["process", campaign, "--out", out, "--no-report", "--json", "--quiet", *QUICK]
    code, _, errors = shell(arguments, ">/dev/full", tmp_path)
    assert code == 2
    assert errors.startswith("Error: standard output")
    assert (out / MARKER).is_file()
    arguments[3] = tmp_path / "other"
    code, output, _ = shell(arguments, "2>/dev/full", tmp_path)
    assert code == 0
    assert json.loads(output)["result"] == str(tmp_path / "other")


def test_no_message_ends_in_a_file_that_took_the_place_of_a_closed_stream(tmp_path):
    """A library writes to number 2 whatever file that is."""
    program = (
        "import os; from pipelines.cli import streams; streams.make_tolerant();"
        f"file = open({str(tmp_path / 'kept')!r}, 'wb', 0); os.write(2, b'a message'); print('x')"
    )
    command = f'{sys.executable} -c "{program}" <&- >&- 2>&-'
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path])}
    subprocess.run(["bash", "-c", command], env=environment, check=True)
    assert (tmp_path / "kept").read_bytes() == b""


def test_unbuffered_output_is_no_different(campaign, tmp_path):
    arguments = ["inspect", campaign, "--headers"]
    for redirection in ("| true", ">&-", ""):
        code, output, errors = shell(arguments, redirection, tmp_path, PYTHONUNBUFFERED="1")
        assert code == 0
        assert errors == ""
    assert str(campaign) in output
