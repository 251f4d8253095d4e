"""What may go wrong outside: interrupts, full drives, faults, damage."""

import json
import os
import shutil
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from results import tyre_result

from ema.core.errors import InputError
from ema.core.finding import Check, Finding, Verdict
from pipelines.cli import main as cli
from pipelines.cli import result as cli_result
from pipelines.cli import terminal
from pipelines.cli.streams import Interrupted, interruptible, reporting_outcome
from pipelines.report.write import save
from pipelines.results.store import MARKER, load
from pipelines.storage import atomic
from pipelines.storage.atomic import written_whole
from pipelines.storage.checksums import read_marker, write_marker

pytestmark = pytest.mark.usefixtures("modes_once")
PROGRAM = [sys.executable, "-m", "pipelines.cli.main"]


@pytest.fixture(autouse=True)
def minded_interrupts():
    """A job in the background is started with interrupts ignored, and hands that on."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture
def out(tmp_path):
    (tmp_path / "results").mkdir()
    return tmp_path / "results" / "result"


@pytest.fixture
def earlier(out):
    """An earlier result, by its marker."""
    out.mkdir()
    write_marker(out / MARKER, {"campaign": "earlier"})
    return out


def environment(**extra):
    paths = os.pathsep.join([str(Path(cli.__file__).parents[2]), *sys.path])
    return {**os.environ, "PYTHONPATH": paths, "OMP_NUM_THREADS": "1", **extra}


def names(folder):
    return sorted(path.name for path in folder.iterdir())


# Being asked to stop


def interrupting(number):
    def stop(*_, **__):
        signal.raise_signal(number)
        raise AssertionError("the signal had no effect")

    return stop


@pytest.mark.parametrize(
    "stage",
    [
        "ema.read_campaign",
        "ema.estimate_frf",
        "ema.identify_modes",
        "model.tune_ring",
        "pipelines.report.write.write_identification",
        "pipelines.report.write.write_report",
        "pipelines.storage.atomic._swapped",
    ],
)
def test_an_interrupt_at_any_stage(
    ringmodal, short_campaign, short_result, earlier, monkeypatch, stage
):
    if stage.startswith("pipelines."):  # while writing: what was computed does not matter
        monkeypatch.setattr("pipelines.process.run.process", lambda *_: short_result)
    monkeypatch.setattr(stage, interrupting(signal.SIGINT))
    outcome = ringmodal("process", short_campaign, "--out", earlier, "--force", "--quiet")
    assert outcome == (130, "", "Interrupted: the earlier result is unchanged.\n")
    assert names(earlier.parent) == ["result"]
    assert read_marker(earlier / MARKER).content == {"campaign": "earlier"}


def test_a_termination_is_an_interrupt(ringmodal, short_campaign, out, monkeypatch):
    monkeypatch.setattr("ema.estimate_frf", interrupting(signal.SIGTERM))
    outcome = ringmodal("process", short_campaign, "--out", out, "--quiet")
    assert outcome == (143, "", "Interrupted: nothing was written.\n")
    assert names(out.parent) == []


def test_an_interrupt_after_the_result_is_there(ringmodal, short_campaign, out, monkeypatch):
    monkeypatch.setattr("pipelines.cli.result.show", interrupting(signal.SIGINT))
    outcome = ringmodal("process", short_campaign, "--out", out, "--quiet", "--no-report")
    assert outcome == (130, "", f"Interrupted: {out} is complete.\n")
    assert names(out.parent) == ["result"]
    assert load(out).modal_model.modes


def test_an_interrupted_simulation_leaves_nothing(ringmodal, out, monkeypatch):
    monkeypatch.setattr("pipelines.simulate.campaign.manifest_text", interrupting(signal.SIGINT))
    outcome = ringmodal("simulate", "campaign", out, "--duration-s", 1)
    assert outcome == (130, "", "Interrupted: nothing was written.\n")
    assert names(out.parent) == []


def test_a_repeated_interrupt_does_not_cut_the_cleaning_short(out):
    with pytest.raises(Interrupted) as stopped, interruptible(), written_whole(out) as folder:
        try:
            (folder / "modes.csv").write_text("")
            signal.raise_signal(signal.SIGTERM)
        finally:
            signal.raise_signal(signal.SIGINT)
    assert stopped.value.exit_code == 143
    assert names(out.parent) == []


def test_an_interrupt_that_a_library_swallowed_still_counts():
    """As where a module is left half loaded, and misses a name later."""
    with pytest.raises(Interrupted) as stopped, interruptible():
        with suppress(BaseException):
            signal.raise_signal(signal.SIGTERM)
        raise ImportError("cannot import name")
    assert stopped.value.exit_code == 143
    assert isinstance(stopped.value.__cause__, ImportError)


def test_the_program_is_ready_for_an_interrupt_before_it_loads_anything_heavy():
    program = "import sys, pipelines.cli.main; print({'typer', 'numpy', 'ema'} & set(sys.modules))"
    finished = subprocess.run(
        [sys.executable, "-c", program],
        env=environment(),
        capture_output=True,
        text=True,
        check=True,
    )
    assert finished.stdout.strip() == "set()"


def test_signals_are_as_before_afterwards():
    before = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
    with interruptible():
        assert signal.getsignal(signal.SIGINT) != before[0]
    assert (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)) == before


@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="the system has no such signal")
def test_what_nohup_ignores_stays_ignored():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with interruptible():
            signal.raise_signal(signal.SIGHUP)
    finally:
        signal.signal(signal.SIGHUP, before)


def test_an_empty_folder_is_no_earlier_result(out):
    out.mkdir()
    with pytest.raises(Interrupted) as stopped, reporting_outcome(out):
        raise Interrupted(signal.SIGINT)
    assert stopped.value.outcome == "nothing was written"


@pytest.mark.skipif(os.name == "nt", reason="there, a program cannot press another one's Ctrl-C")
def test_ctrl_c_on_the_running_program(short_campaign, out):
    with subprocess.Popen(
        [*PROGRAM, "process", short_campaign, "--out", out],
        env=environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as running:
        progress = running.stderr.readline()
        running.send_signal(signal.SIGINT)
        output, errors = running.communicate()
    assert progress.startswith("Reading")
    assert running.returncode == 130
    assert output == ""
    assert errors.splitlines()[-1] == "Interrupted: nothing was written."
    assert "Traceback" not in errors
    assert names(out.parent) == []


# Drives


@pytest.mark.skipif(os.name != "posix", reason="the system sets no limits on files")
def test_a_full_drive_is_noticed_by_every_writer(tmp_path, out, monkeypatch):
    import resource

    result = tyre_result()
    save(result, tmp_path / "complete", report=False)
    sizes = sorted({path.stat().st_size for path in (tmp_path / "complete").iterdir()})
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    monkeypatch.setattr(atomic, "_PROBE_BYTES", 0)
    for size in sizes:  # too little for one writer after the other
        resource.setrlimit(resource.RLIMIT_FSIZE, (size * 9 // 10, limits[1]))
        try:
            with pytest.raises(InputError, match="could not be written"):
                save(result, out, report=False)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        assert names(out.parent) == []


@pytest.mark.skipif(os.name != "posix", reason="the system sets no limits on files")
def test_a_full_drive_is_noticed_before_anything_is_computed(short_campaign, out):
    program = (
        "import resource, sys; from pipelines.cli.main import main;"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, 10_000)); main()"
    )
    finished = subprocess.run(
        [sys.executable, "-c", program, "process", short_campaign, "--out", out],
        env=environment(),
        capture_output=True,
        text=True,
        check=False,
    )
    assert finished.returncode == 2
    assert "Reading" not in finished.stderr
    assert "could not be written" in finished.stderr
    assert names(out.parent) == []


def test_an_unwritable_place_is_noticed_before_anything_is_computed(
    ringmodal, short_campaign, tmp_path
):
    (tmp_path / "file").write_text("")
    code, _, errors = ringmodal("process", short_campaign, "--out", tmp_path / "file" / "result")
    assert code == 2
    assert "Reading" not in errors
    assert names(tmp_path) == ["file"]


def test_a_folder_that_vanishes_while_the_report_is_written(
    ringmodal, short_campaign, out, monkeypatch
):
    monkeypatch.setattr("pipelines.report.write.write_report", lambda *_: shutil.rmtree(out.parent))
    code, _, errors = ringmodal("process", short_campaign, "--out", out, "--quiet")
    assert code == 2
    assert f"Error: {out}: No such file" in errors
    assert not out.parent.exists()


def test_recordings_that_vanish_are_named(ringmodal, short_campaign, out, monkeypatch):
    def vanish(*_, **__):
        raise FileNotFoundError(2, "No such file or directory", "/mnt/lab/config_1.uff")

    monkeypatch.setattr("ema.estimate_frf", vanish)
    code, _, errors = ringmodal("process", short_campaign, "--out", out, "--quiet")
    assert code == 2
    assert errors.startswith("Error: /mnt/lab/config_1.uff: No such file or directory;")
    assert names(out.parent) == []


# Faults of the program, too little memory


FAULTY = """
import sys
from pipelines.prepare import inspection
from pipelines.cli.main import main

def fail(*_, **__):
    raise RuntimeError("a fault")

inspection.inspect_files = fail
main()
"""


@pytest.mark.parametrize(
    ("arguments", "extra", "shown"),
    [([], {}, False), ([], {"RINGMODAL_DEBUG": "1"}, True), (["--debug"], {}, True)],
)
def test_a_fault_is_one_line_to_report_and_a_traceback_on_demand(arguments, extra, shown):
    finished = subprocess.run(
        [sys.executable, "-c", FAULTY, *arguments, "inspect", "config_1.uff"],
        env=environment(**extra),
        capture_output=True,
        text=True,
        check=False,
    )
    assert finished.returncode == 1
    assert ("Traceback" in finished.stderr) == shown
    assert "RuntimeError: a fault" in finished.stderr
    if not shown:
        assert len(finished.stderr.splitlines()) == 1
        assert "Please report it" in finished.stderr


def test_too_little_memory_is_said(ringmodal, short_campaign, out, monkeypatch):
    def fail(*_, **__):
        raise MemoryError("Unable to allocate 3.2 TiB")

    monkeypatch.setattr("ema.estimate_frf", fail)
    code, _, errors = ringmodal("process", short_campaign, "--out", out, "--quiet")
    assert code == 1
    assert errors.startswith("Error: not enough memory (Unable to allocate 3.2 TiB). ")
    assert names(out.parent) == []


# Nobody let in


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    folder = tmp_path_factory.mktemp("stored") / "result"
    save(tyre_result(), folder, report=False)
    return folder


@given(st.data())
def test_a_damaged_result_is_named_whatever_happened_to_its_bytes(stored, tmp_path_factory, data):
    copy = Path(shutil.copytree(stored, tmp_path_factory.mktemp("damaged") / "result"))
    names = ["identification.json", "residues.parquet", "poles.parquet", MARKER, "frf.parquet"]
    path = copy / data.draw(st.sampled_from(names))
    content = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.integers(0, len(content) - 1))
        content[at : at + data.draw(st.integers(1, 8))] = data.draw(st.binary(max_size=8))
    changed = bytes(content) != path.read_bytes()
    path.write_bytes(content)
    if path.name == MARKER:  # white space means nothing in it
        changed = read_marker(path) != read_marker(stored / MARKER)
    if changed:
        with pytest.raises(InputError, match=path.name):
            load(copy)
        with suppress(InputError):
            load(copy, accept_changes=True)
    shutil.rmtree(copy.parent)


@pytest.mark.parametrize("name", ["x[/red]y", "[bold]x", "\x1b]0;title\x07\x1b[31m", "a\u202eb\nc"])
def test_names_from_files_are_texts_on_a_terminal(capsys, monkeypatch, name):
    monkeypatch.delenv("COLUMNS", raising=False)
    finding = Finding(name, name, None, Check.HUM, Verdict.WARNING, name)
    result = tyre_result(name=name, findings=(finding,), notes=(name,))
    cli_result.show(result, Path("result"), as_json=False, report=True)
    terminal.echo_error(str(InputError(name, name, name, name)))
    output, errors = capsys.readouterr()
    shown = terminal.printable(name)
    assert f"Modes of {shown}" in output
    assert f"Warning: Hum: {shown} {shown}: {shown}" in errors
    assert f"{shown}: {shown}; {shown}. {shown}." in errors
    assert all(line.isprintable() for line in (output + errors).split("\n"))


@pytest.mark.parametrize("options", [None, {}, {"tune": True}])
def test_a_result_without_its_options_is_no_fault_of_the_program(
    ringmodal, stored, tmp_path, options
):
    copy = Path(shutil.copytree(stored, tmp_path / "result"))
    content = json.loads((copy / MARKER).read_text(encoding="utf-8"))
    write_marker(copy / MARKER, content | {"options": options})
    code, _, errors = ringmodal("report", copy)
    assert code == 2
    assert "provenance.json, options" in errors
