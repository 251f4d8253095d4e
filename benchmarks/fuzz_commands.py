"""Fuzz whole command lines: python benchmarks/fuzz_commands.py --cases 5000 --seed 1.

Every case draws a command with its options, makes the inputs that it names by changing good ones,
and runs it in a process forked from one that has everything loaded. `fuzz_command_verdict.py` says
what counts as a failure. The same seed gives the same cases; `--only K` runs one of them and shows
what it said. Linux only.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import pkgutil
import random
import shutil
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "MALLOC_ARENA_MAX"):
    os.environ[_name] = "1"
os.environ["ARROW_DEFAULT_MEMORY_POOL"] = "system"
os.environ["MPLBACKEND"] = "Agg"
sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from fuzz_command_inputs import Inputs  # noqa: E402
from fuzz_command_lines import Line, Lines  # noqa: E402
from fuzz_command_seeds import make_seeds  # noqa: E402
from fuzz_command_verdict import STREAMS, Usage, faults, place_of, run_command, snapshot  # noqa: E402

_MEMORY_DISK = "/dev/shm" if Path("/dev/shm").is_dir() else None
_PLAIN_SHARE = 0.85
_ENCODINGS = ("utf-8",) * 6 + ("ascii", "cp1252")
_HEAVY = (
    *("scipy.signal", "scipy.optimize", "scipy.io", "scipy.special", "scipy.linalg", "scipy.stats"),
    *("pyarrow.csv", "pyarrow.parquet", "pyarrow.feather", "pyarrow.compute", "h5py", "nptdms"),
    *("matplotlib.pyplot", "matplotlib.backends.backend_agg", "matplotlib.backends.backend_svg"),
    *(
        "pandas",
        "rich.table",
        "rich.progress",
        "tomlkit",
        "pydantic",
        "jinja2",
        "getpass",
        "weasyprint",
    ),
)


def load_everything() -> None:
    """Import all that a command may import: what it then takes is its own."""
    for package in ("ema", "model", "pipelines"):
        root = importlib.import_module(package)
        for found in pkgutil.walk_packages(root.__path__, f"{package}."):
            if not found.name.endswith("__main__"):
                importlib.import_module(found.name)
    for name in _HEAVY:
        importlib.import_module(name)


class Case:
    """Case number K: its folder, its command line, its verdict."""

    def __init__(self, seeds: Path, seed: int, number: int, lines: Lines) -> None:
        self.seeds, self.number, self.lines = seeds, number, lines
        self.key = f"{seed}:{number}"

    def prepare(self, folder: Path) -> dict[str, Any]:
        """Draw the command line and make its inputs, in a process of its own."""
        world, told = folder / "world", folder / "case.json"
        world.mkdir(parents=True)
        in_a_child(lambda: told.write_text(json.dumps(self._drawn(world))))
        return json.loads(told.read_text())

    def _drawn(self, world: Path) -> dict[str, Any]:
        rng = random.Random(self.key)
        inputs = Inputs(self.seeds, world, rng)
        line = self.lines.draw(rng, inputs)
        plain = rng.random() < _PLAIN_SHARE
        return {
            "line": asdict(line),
            "foreign": [str(path.relative_to(world)) for path in inputs.foreign],
            "streams": "plain" if plain else rng.choice(sorted(STREAMS)),
            "encoding": rng.choice(_ENCODINGS),
            "stdin": rng.choice(("", "y\n", "n\n", "x\n")),
            "columns": rng.choice(("", "", "40", "200", "x")),
        }

    def run(self, folder: Path, *, debug: bool = False) -> dict[str, Any]:
        """Run it in a folder and judge."""
        case = self.prepare(folder)
        world, log = folder / "world", folder / "log"
        line = Line(**case["line"])
        before = snapshot(world)
        size = sum(
            p.lstat().st_size for p in world.rglob("*") if p.is_file() and not p.is_symlink()
        )
        home = folder / "home"
        home.mkdir()
        environment = {"HOME": str(home), "XDG_CACHE_HOME": str(home), "MPLCONFIGDIR": str(home)}
        if case["columns"]:
            environment["COLUMNS"] = case["columns"]
        if debug:
            environment["RINGMODAL_DEBUG"] = "1"
        streams = "plain" if debug else case["streams"]
        usage = run_command(
            line.arguments,
            world,
            log,
            streams=streams,
            encoding=case["encoding"],
            stdin=case["stdin"],
            environment=environment,
        )
        found = faults(line, usage, log, streams, size, before, snapshot(world), case["foreign"])
        return {
            "number": self.number,
            **case,
            "size": size,
            **asdict(usage),
            "faults": found,
            "refused_for_memory": _refused_for_memory(log, usage),
            "said": _text(log / "stderr")[-300:],
        }


def _refused_for_memory(log: Path, usage: Usage) -> bool:
    return usage.code == 1 and "not enough memory" in _text(log / "stderr")


def _text(path: Path) -> str:
    return path.read_text(errors="replace") if path.exists() else ""


def in_a_child(act: Callable[[], object]) -> None:
    """Do something in a forked process: threads that libraries start end with it."""
    pid = os.fork()
    if pid == 0:
        code = 1
        try:
            act()
            code = 0
        except BaseException:  # noqa: BLE001
            sys.excepthook(*sys.exc_info())
        finally:
            os._exit(code)
    if os.waitpid(pid, 0)[1]:
        raise RuntimeError("the fuzzer itself failed")


def lane(
    numbers: list[int], asked: argparse.Namespace, seeds: Path, scratch: Path, lines: Lines
) -> None:
    """Run cases one after the other; results are lines of JSON."""
    with (scratch / f"lane_{numbers[0]}.jsonl").open("w") as results:
        for number in numbers:
            folder = scratch / f"case_{number}"
            case = Case(seeds, asked.seed, number, lines)
            found = case.run(folder)
            if found["faults"]:
                _explain(case, found, folder, asked.keep)
            results.write(json.dumps(found) + "\n")
            results.flush()
            shutil.rmtree(folder)


def _explain(case: Case, found: dict[str, Any], folder: Path, keep: Path) -> None:
    """Where it happened, by the debug mode; and all that is needed to do it again."""
    place = ""
    again = folder.with_name(folder.name + "_again")
    if any(each.startswith(("exit code", "traceback", "time")) for each in found["faults"]):
        case.run(again, debug=True)
        place = place_of(_text(again / "log" / "stderr"))
    found["place"] = place
    there = keep / f"{case.key.replace(':', '_')}"
    shutil.rmtree(there, ignore_errors=True)
    shutil.rmtree(again, ignore_errors=True)
    case.prepare(there)
    if (folder / "log").exists():
        shutil.copytree(folder / "log", there / "log")


def summarise(results: list[dict[str, Any]], seconds: float) -> bool:
    """Print the figures and every kind of failure; returns whether there was any."""
    codes: dict[int, int] = defaultdict(int)
    kinds: dict[str, list[dict[str, Any]]] = defaultdict(list)
    for each in results:
        codes[each["code"]] += 1
        for fault in each["faults"]:
            kinds[_kind(fault, each)].append(each)
    slowest = max(results, key=lambda each: each["spent_s"])
    largest = max(results, key=lambda each: each["memory_bytes"] - 4 * each["size"])
    print(
        f"{len(results)} command lines in {seconds:.0f} s; exit codes "
        + ", ".join(f"{code}: {n}" for code, n in sorted(codes.items()))
    )
    print(
        f"slowest {slowest['spent_s']:.1f} s (case {slowest['number']}); most memory "
        f"{largest['memory_bytes'] >> 20} MB for {largest['size'] >> 10} kB "
        f"(case {largest['number']}); "
        f"{sum(each['refused_for_memory'] for each in results)} refused for memory"
    )
    for kind, cases in sorted(kinds.items(), key=lambda item: -len(item[1])):
        print(f"{len(cases):5d} × {kind}")
        for each in cases[:3]:
            said = " ".join(map(repr, each["line"]["arguments"]))
            print(f"        case {each['number']}: {each['streams']}: {said[:230]}")
    print(f"{len(kinds)} kinds of failure")
    return bool(kinds)


def _kind(fault: str, case: dict[str, Any]) -> str:
    head = fault.split(":")[0] if not fault.startswith("raw") else fault
    if fault.startswith(("exit code", "traceback", "time")):
        return f"{head} [{case.get('place') or case['streams']}]"
    return f"{head} [{case['line']['command']}]"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=5000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument("--only", type=int, help="run this case alone and show what it said")
    parser.add_argument("--lanes", type=int, default=2, help="commands at a time")
    parser.add_argument(
        "--keep", type=Path, default=Path(tempfile.gettempdir()) / "ringmodal_commands"
    )
    parser.add_argument("--seeds", type=Path, help="folder of good inputs, made if it is not there")
    asked = parser.parse_args()
    asked.keep.mkdir(parents=True, exist_ok=True)
    began = time.monotonic()
    # Not TemporaryDirectory: every forked process would remove it when it ends.
    scratch = Path(tempfile.mkdtemp(dir=_MEMORY_DISK))
    try:
        results = _all_cases(asked, scratch)
    finally:
        shutil.rmtree(scratch)
    if not results:
        return
    results.sort(key=lambda each: each["number"])
    (asked.keep / "results.jsonl").write_text("".join(json.dumps(each) + "\n" for each in results))
    raise SystemExit(summarise(results, time.monotonic() - began) or len(results) != asked.cases)


def _all_cases(asked: Any, scratch: Path) -> list[dict[str, Any]]:
    seeds = asked.seeds or scratch / "seeds"
    load_everything()
    if not seeds.exists():
        in_a_child(lambda: make_seeds(seeds))
    lines = Lines()
    if asked.only is not None:
        _show(Case(seeds, asked.seed, asked.only, lines), scratch, asked.keep)
        return []
    numbers = list(range(asked.first, asked.first + asked.cases))
    shares = [numbers[k :: asked.lanes] for k in range(min(asked.lanes, len(numbers)))]
    _in_lanes(shares, asked, seeds, scratch, lines)
    paths = sorted(scratch.glob("lane_*.jsonl"))
    return [json.loads(text) for path in paths for text in path.read_text().splitlines()]


def _in_lanes(
    shares: list[list[int]], asked: Any, seeds: Path, scratch: Path, lines: Lines
) -> None:
    pids = []
    for numbers in shares:
        pid = os.fork()
        if pid == 0:
            try:
                lane(numbers, asked, seeds, scratch, lines)
            except BaseException:  # noqa: BLE001
                sys.excepthook(*sys.exc_info())
            finally:
                sys.stdout.flush()
                os._exit(0)
        pids.append(pid)
    for pid in pids:
        os.waitpid(pid, 0)


def _show(case: Case, scratch: Path, keep: Path) -> None:
    found = case.run(scratch / "case")
    print("ringmodal", *map(repr, found["line"]["arguments"]))
    print({key: value for key, value in found.items() if key not in ("line", "faults")})
    for name in ("stdout", "stderr"):
        print(f"--- {name}\n{_text(scratch / 'case' / 'log' / name)[:4000]}")
    print("--- faults", *found["faults"], sep="\n")
    if found["faults"]:
        _explain(case, found, scratch / "case", keep)
        print(found["place"], f"kept in {keep}")


if __name__ == "__main__":
    main()
