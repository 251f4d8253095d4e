"""One command in a process forked from one that has everything loaded: limits, streams, usage."""

from __future__ import annotations

import atexit
import contextlib
import io
import os
import resource
import signal
import sys
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

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
    from pipelines.cli.main import main

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
