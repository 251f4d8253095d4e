"""One command in a process forked from one that has everything loaded, and how it may fail."""

from __future__ import annotations

import atexit
import contextlib
import hashlib
import io
import json
import os
import re
import resource
import signal
import stat
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

from fuzz_command_lines import Line

from pipelines.cli.main import main

MOST_S = 20.0
_DOCTOR_S = 60.0  # starts six processes, of which each may wait for a processor
_NO_FILE_ABOVE_BYTES = 512 << 20
_ADDRESS_SPACE_BYTES = 8 << 30  # on top of what is in use: a runaway must not take the machine
_LONGEST_WALL_S = 120.0  # whatever else the machine does
_POLL_S = 0.004
_PAGE = resource.getpagesize()
_EXIT_UNFLUSHED = 120  # Python's own code when standard output cannot be written at the end

STREAMS = {  # standard output and error
    "plain": ("file", "file"),
    "no stdout": ("closed", "file"),
    "no stderr": ("file", "closed"),
    "neither": ("closed", "closed"),
    "stdout ended": ("broken", "file"),
    "stderr ended": ("file", "broken"),
    "both ended": ("broken", "broken"),
    "stdout full": ("full", "file"),
    "stderr full": ("file", "full"),
}


@dataclass(frozen=True)
class Usage:
    """How a command ended and what it took.

    Attributes
    ----------
    code : int
        Exit code; negative for a signal.
    spent_s : float
        Time by the clock without the time that the process waited for a processor.
    memory_bytes : int
        Growth of its peak resident memory over what was loaded before.
    timed_out : bool
    """

    code: int
    spent_s: float
    memory_bytes: int
    timed_out: bool


def run_command(
    arguments: list[str],
    folder: Path,
    log: Path,
    *,
    streams: str,
    encoding: str,
    stdin: str,
    environment: dict[str, str],
) -> Usage:
    """Run ``ringmodal`` with arguments in a folder; what it says goes into files in `log`."""
    log.mkdir(parents=True, exist_ok=True)
    (log / "stdin").write_text(stdin)
    began = time.monotonic()
    pid = os.fork()
    if pid == 0:
        code = 1
        try:
            _settle(folder, log, streams, encoding, environment)
            code = _main(arguments)
        finally:
            os._exit(code)
    return _watch(pid, began, _DOCTOR_S if "doctor" in arguments else MOST_S)


def resident_bytes() -> int:
    """Resident memory of this process."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * _PAGE


def _watch(pid: int, began: float, most_s: float) -> Usage:
    base = resident_bytes()
    timed_out = False
    while os.waitid(os.P_PID, pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is None:
        wall_s = time.monotonic() - began
        if wall_s > most_s and (_spent_s(pid, began) > most_s or wall_s > _LONGEST_WALL_S):
            timed_out = True
            os.killpg(pid, signal.SIGKILL)
            break
        time.sleep(_POLL_S)
    os.waitid(os.P_PID, pid, os.WEXITED | os.WNOWAIT)
    spent_s = _spent_s(pid, began)
    _, status, used = os.wait4(pid, 0)
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(pid, signal.SIGKILL)  # workers that it left behind
    return Usage(
        os.waitstatus_to_exitcode(status), spent_s, max(0, used.ru_maxrss * 1024 - base), timed_out
    )


def _spent_s(pid: int, began: float) -> float:
    waited_s = 0.0
    with contextlib.suppress(OSError, IndexError):
        waited_s = int(Path(f"/proc/{pid}/schedstat").read_text().split()[1]) * 1e-9
    return time.monotonic() - began - waited_s


def _settle(
    folder: Path, log: Path, streams: str, encoding: str, environment: dict[str, str]
) -> None:
    """Give a forked process what a fresh one would have."""
    os.setsid()
    sys.modules["__main__"] = ModuleType("__main__")  # spawned workers must not load the fuzzer
    os.chdir(folder)
    os.environ.update(environment)
    in_use = int(Path("/proc/self/statm").read_text().split()[0]) * _PAGE
    for which, most in (
        (resource.RLIMIT_AS, in_use + _ADDRESS_SPACE_BYTES),
        (resource.RLIMIT_FSIZE, _NO_FILE_ABOVE_BYTES),
        (resource.RLIMIT_CORE, 0),
    ):
        resource.setrlimit(which, (most, resource.getrlimit(which)[1]))
    stdin = os.open(log / "stdin", os.O_RDONLY)
    os.dup2(stdin, 0)
    os.close(stdin)
    for number, kind in zip((1, 2), STREAMS[streams], strict=True):
        _connect(number, kind, log / ("stdout" if number == 1 else "stderr"))
    sys.stdin = open(0, encoding=encoding, closefd=False)  # noqa: SIM115
    sys.stdout = None if STREAMS[streams][0] == "closed" else _text(1, encoding, "strict")
    sys.stderr = None if STREAMS[streams][1] == "closed" else _text(2, encoding, "backslashreplace")
    sys.__stdin__, sys.__stdout__, sys.__stderr__ = sys.stdin, sys.stdout, sys.stderr  # type: ignore[misc]


def _text(number: int, encoding: str, errors: str) -> io.TextIOWrapper:
    return open(
        number,
        "w",
        encoding=encoding,
        errors=errors,
        buffering=1 if number == 2 else -1,
        closefd=False,
    )


def _connect(number: int, kind: str, path: Path) -> None:
    if kind == "closed":
        os.close(number)
        return
    if kind == "broken":
        reading, opened = os.pipe()
        os.close(reading)
    elif kind == "full":
        opened = os.open("/dev/full", os.O_WRONLY)
    else:
        opened = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(opened, number)
    os.close(opened)


def _main(arguments: list[str]) -> int:
    """What the interpreter does around ``main()``: exit codes, uncaught errors, the last flush."""
    sys.argv = ["ringmodal", *arguments]
    code = 0
    try:
        main()
    except SystemExit as ended:
        code = ended.code if isinstance(ended.code, int) else int(ended.code is not None)
    except BaseException:  # noqa: BLE001
        sys.excepthook(*sys.exc_info())
        code = 1
    threading._shutdown()
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        try:
            if stream is not None and not stream.closed:
                stream.flush()
        except OSError:
            code = _EXIT_UNFLUSHED
    return code & 0xFF


TIMES_INPUT = 4
# What a command takes whatever its input: buffers of a stage, libraries that load late.
ALLOWANCE_BYTES = 128 << 20
# Typesetting loads fonts; a simulation holds what its options ask for, up to their limits, and the
# demo processes recordings that it brings.
_MORE_BYTES = {"--pdf": 128 << 20, "demo": 64 << 20, "simulate": 256 << 20, "paper": 256 << 20}
_DOCUMENTED = (0, 2)
# Exit code 1 is theirs to say that something was found.
_MAY_END_WITH_1 = {"doctor", "batch"}
# These speak of many files, and name each that is bad.
_SPEAKS_OF_MANY = {"inspect", "batch", "tyre list", "tyre history", "tyre table", "tyre series"}
_OUT_OF_MEMORY = re.compile(r"^Error: not enough memory", re.M)
_MESSAGE = re.compile(r"^(Error|Usage|Interrupted)\b", re.M)
_ERROR_LINES = re.compile(r"^Error: ", re.M)
_PYTHON_WARNING = re.compile(r"^\S+\.py:\d+: \w+|^\w*Warning: .*\n  \w", re.M)
_CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]")
_PLACE = re.compile(r'File "\S*/((?:ema|model|pipelines)/\S+\.py)", line (\d+), in (\S+)')
_RAISED = re.compile(
    r"^(\w[\w.]*(?:Error|Exception|Warning|Interrupt|Fault|Exit|Trouble|Damage\w*))\b", re.M
)

Snapshot = dict[str, str]


def snapshot(folder: Path) -> Snapshot:
    """Everything below a folder: path → what it is and holds."""
    return dict(_entries(folder, folder))


def _entries(folder: Path, root: Path) -> Iterator[tuple[str, str]]:
    for path in sorted(folder.iterdir()):
        name, mode = str(path.relative_to(root)), path.lstat().st_mode
        if stat.S_ISLNK(mode):
            yield name, f"link {path.readlink()}"
        elif stat.S_ISDIR(mode):
            yield name, "folder"
            yield from _entries(path, root)
        elif stat.S_ISREG(mode):
            yield name, hashlib.sha256(path.read_bytes()).hexdigest()
        else:
            yield name, "special"


def faults(
    line: Line,
    usage: Usage,
    log: Path,
    streams: str,
    input_bytes: int,
    before: Snapshot,
    after: Snapshot,
    foreign: list[str],
) -> list[str]:
    """Name everything that is wrong with how a command ended."""
    out, err = (_said(log / name) for name in ("stdout", "stderr"))
    heard = STREAMS[streams][1] == "file"
    found = [
        *_of_ending(line, usage, err, heard=heard),
        *_of_screen(line, usage, out, err, streams),
    ]
    most = ALLOWANCE_BYTES + sum(
        more for word, more in _MORE_BYTES.items() if word in line.arguments
    )
    if usage.memory_bytes > TIMES_INPUT * input_bytes + most:
        found.append(f"memory: {usage.memory_bytes >> 20} MB for {input_bytes >> 10} kB")
    # Where the last word could not be said, a complete result may stand beside a code that says so.
    silent = streams != "plain" and usage.code != 0
    return [*found, *_of_files(line, 0 if silent else usage.code, before, after, foreign)]


def _said(path: Path) -> str:
    return path.read_bytes().decode("utf-8", "replace") if path.exists() else ""


def _of_ending(line: Line, usage: Usage, err: str, *, heard: bool) -> Iterator[str]:
    if usage.timed_out:
        yield "time"
        return
    known = usage.code in _DOCUMENTED or (usage.code == 1 and line.command in _MAY_END_WITH_1)
    if usage.code == 1 and _OUT_OF_MEMORY.search(err):
        known = True
    if not known:
        yield f"exit code {usage.code}"
    elif usage.code == 2 and heard:
        if line.command in _SPEAKS_OF_MANY:
            return
        if not _MESSAGE.search(err):
            yield "exit 2 without a message"
        elif len(_ERROR_LINES.findall(err)) > 1:
            yield "several error messages"


def _of_screen(line: Line, usage: Usage, out: str, err: str, streams: str) -> Iterator[str]:
    if "Traceback (most recent call last)" in err and "--debug" not in line.arguments:
        yield "traceback"
    if _PYTHON_WARNING.search(err):
        yield f"raw warning: {_PYTHON_WARNING.search(err).group()[:150]}"
    if "Exception ignored" in err:
        yield "exception ignored"
    for name, text in (("stdout", out), ("stderr", err)):
        if (sign := _CONTROL.search(text)) is not None:
            yield f"control character {sign.group()!r} on {name}"
    is_json = "--json" in line.arguments and not {"--help", "-h", "--version"} & set(line.arguments)
    if usage.code == 0 and is_json and STREAMS[streams][0] == "file":
        try:
            json.loads(out, parse_constant=_refuse)
        except ValueError as error:
            yield f"no JSON on stdout: {str(error)[:40]}"


def _refuse(name: str) -> None:
    raise ValueError(name)


def _of_files(
    line: Line, code: int, before: Snapshot, after: Snapshot, foreign: list[str]
) -> Iterator[str]:
    for name in foreign:
        if after.get(name) != before[name]:
            yield f"foreign file lost: {name}"
    changed = sorted(name for name, was in before.items() if after.get(name, "") != was)
    new = sorted(set(after) - set(before))
    if code != 0:
        if changed and not _goes_on(line):
            yield f"changed though it failed: {changed[0]}"
        if new and not _goes_on(line):
            yield f"left behind: {new[0]}"
        return
    if hidden := [name for name in new if Path(name).name.startswith(".")]:
        yield f"left behind: {hidden[0]}"
    lost = [name for name in changed if not _may_change(line, name)]
    if lost:
        yield f"input changed or lost: {lost[0]}"


def _goes_on(line: Line) -> bool:
    """Whether a command keeps what it did before it failed."""
    return line.command == "batch"


def _may_change(line: Line, name: str) -> bool:
    command, arguments = line.command, line.arguments
    folders = [name, *map(str, Path(name).parents)]
    given = {str(Path(path)) for path in line.outputs} - {"."}
    if any(each in given for each in folders):
        return line.may_replace or not command.startswith(
            ("process", "export", "compare", "init", "paper")
        )
    if command in ("tune", "report"):
        return any(each in {str(Path(a)) for a in arguments} for each in folders)
    if command == "init":
        return name.endswith("campaign.toml") and line.may_replace
    if command == "tyre update-tir":
        return "--yes" in arguments and name in {str(Path(a)) for a in arguments}
    return False


def place_of(err: str) -> str:
    """Exception and innermost place of ours that a traceback names."""
    raised, places = _RAISED.findall(err), _PLACE.findall(err)
    place = f"{places[-1][0]}:{places[-1][1]} {places[-1][2]}" if places else "elsewhere"
    return f"{raised[-1] if raised else '?'} at {place}"
