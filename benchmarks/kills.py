"""Kill `ringmodal process` at random moments and look at what is left: ``kills.py --kills 100``.

A small campaign is processed into an empty place and, every second time, over an earlier result
made with other options. Each process is ended by SIGKILL, which no program can catch, at a moment
drawn evenly from its whole duration. The place must then hold nothing, or the earlier result, or
the new one: every file of the contract, readable, and with the checksum that completed runs gave.
Every fourth time somebody puts a hidden file, a repository and a note into the earlier result while
it is being replaced: they must be found afterwards in the result or in a visible folder beside it.

With ``--sign-off`` it is the server of `ringmodal review` that is killed while it signs: the new
folder is whole or not there, the reviewed one is untouched, and the edit is in the draft or signed.
The token must be in nothing that the server said, nor among its arguments.
"""

from __future__ import annotations

import argparse
import csv
import http.client
import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
import threading
import time
import tomllib
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
from review import Client, served

from pipelines.process.run import process
from pipelines.report.write import save
from pipelines.results.store import load
from pipelines.simulate.campaign import simulate_campaign
from pipelines.storage.atomic import recover
from pipelines.storage.checksums import sha256

TABLES = ("modes.csv", "shapes.csv", "quality.csv", "validation.csv")
PARQUET = ("frf.parquet", "poles.parquet")
CONTRACT = (*TABLES, *PARQUET, "frf.uff", "tyre.toml", "report.html", "provenance.json")
DATED = ("report.html", "provenance.json", "tyre.toml")  # differ by date and stage times

EARLIER = ("--estimator", "H2", "--max-order", "40")
NEW: tuple[str, ...] = ()

NOTHING, OLD_STANDS, NEW_STANDS, PARTIAL = "nothing", "the earlier result", "the new one", "PARTIAL"
THEIRS = (".notes.txt", ".git/config", "notes.txt")  # what a user may put into a result


@dataclass(frozen=True)
class Checksums:
    """What completed runs with the earlier and with the new options wrote."""

    earlier: dict[str, str]
    new: dict[str, str]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--sign-off", action="store_true", help="kill the review instead")
    chosen = parser.parse_args()
    draw = random.Random(chosen.seed)
    if chosen.sign_off:
        sys.exit(signing(chosen.kills, draw))
    with tempfile.TemporaryDirectory() as scratch:
        campaign = simulate_campaign(Path(scratch) / "campaign", duration_s=4.0)
        earlier, new = Path(scratch) / "earlier", Path(scratch) / "new"
        complete(campaign, earlier, EARLIER)
        complete(campaign, new, NEW)
        start = time.perf_counter()
        complete(campaign, new, (*NEW, "--force"))
        duration_s = time.perf_counter() - start
        expected = Checksums(checksums(earlier), checksums(new))
        place = Path(scratch) / "place" / "result"
        rows: list[tuple[bool, str, str, int]] = []
        while len(rows) < chosen.kills:
            replacing, with_theirs = len(rows) % 2 == 1, len(rows) % 4 == 3
            prepare(place, earlier if replacing else None)
            delay_s = draw.uniform(0.0, duration_s)
            added_s = draw.uniform(0.0, delay_s) if with_theirs else None
            stage = kill_at(campaign, place, delay_s, added_s)
            if stage is not None:
                found = verdict(place, expected, replacing, with_theirs=with_theirs)
                rows.append((replacing, stage, found, leftovers(place)))
        prepare(place, new)
        complete(campaign, place, (*NEW, "--force"))
        report(rows, duration_s, leftovers(place))
    sys.exit(any(row[2] == PARTIAL for row in rows))


def command(campaign: Path, out: Path, options: tuple[str, ...]) -> list[str]:
    program = [sys.executable, "-m", "pipelines.cli.main", "process", str(campaign)]
    return [*program, "--out", str(out), *options]


def complete(campaign: Path, out: Path, options: tuple[str, ...]) -> None:
    subprocess.run(command(campaign, out, options), check=True, capture_output=True)


def prepare(place: Path, earlier: Path | None) -> None:
    """Leave what killed processes left beside the place: the next one is to clean up."""
    place.parent.mkdir(exist_ok=True)
    for path in place.parent.iterdir():
        if not path.name.startswith("."):
            shutil.rmtree(path)
    if earlier is not None:
        shutil.copytree(earlier, place)


def kill_at(campaign: Path, place: Path, delay_s: float, added_s: float | None) -> str | None:
    """Kill a run after a time and return what it did then; None where it had ended.

    Somebody's files are put into the place after `added_s`.
    """
    with tempfile.TemporaryFile("w+") as errors:
        running = subprocess.Popen(
            command(campaign, place, (*NEW, "--force")), stdout=subprocess.DEVNULL, stderr=errors
        )
        if added_s is not None:
            time.sleep(added_s)
            add_theirs(place)
        time.sleep(delay_s - (added_s or 0.0))
        writing = any(f"-{running.pid}-" in path.name for path in hidden(place))
        running.kill()
        running.wait()
        errors.seek(0)
        stages = [line for line in errors.read().splitlines() if line.endswith("…")]
    if running.returncode == 0:
        return None
    if not stages:
        return "Starting"
    return "Writing" if writing else stages[-1].removesuffix(" …")


def add_theirs(place: Path) -> None:
    """Do as a user does who does not know that the result is being replaced."""
    for name in THEIRS:
        with suppress(FileNotFoundError):  # the result has just moved
            (place / name).parent.mkdir(exist_ok=True)
            (place / name).write_text(name)


def theirs_are_found(place: Path) -> bool:
    """Whether all of somebody's files are in the result or in visible folders beside it."""
    folders = [path for path in place.parent.iterdir() if not path.name.startswith(".")]
    return all(any((folder / name).is_file() for folder in folders) for name in THEIRS)


def hidden(place: Path) -> list[Path]:
    return [path for path in place.parent.iterdir() if path.name.startswith(".")]


def leftovers(place: Path) -> int:
    """Hidden folders beside the place, for the next run to remove."""
    return len(hidden(place))


def verdict(place: Path, expected: Checksums, replacing: bool, *, with_theirs: bool) -> str:
    """What is at the place; anything that is not one complete result is partial."""
    recover(place)
    if with_theirs:
        if not theirs_are_found(place):
            return PARTIAL
        for name in (".git", *THEIRS):
            path = place / name
            shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)
    if not place.exists():
        return PARTIAL if replacing else NOTHING
    found = checksums(place)
    if not readable(place):
        return PARTIAL
    estimator = json.loads((place / "provenance.json").read_text())["options"]["estimator"]
    if found == expected.new and estimator == "H1":
        return NEW_STANDS
    if replacing and found == expected.earlier and estimator == "H2":
        return OLD_STANDS
    wanted = expected.new if estimator == "H1" else expected.earlier
    print(f"{estimator}: {sorted(set(found.items()) ^ set(wanted.items()))}", file=sys.stderr)
    return PARTIAL


def checksums(folder: Path) -> dict[str, str]:
    return {path.name: "" if path.name in DATED else sha256(path) for path in folder.iterdir()}


def readable(folder: Path) -> bool:
    """Whether every file of the contract is there and can be read to its end."""
    if any(not (folder / name).is_file() for name in CONTRACT):
        return False
    load(folder)
    for name in TABLES:
        with (folder / name).open(newline="") as file:
            if len({len(row) for row in csv.reader(file)}) != 1:
                return False
    for name in PARQUET:
        pq.read_table(folder / name)
    tomllib.loads((folder / "tyre.toml").read_text())
    return (folder / "report.html").read_text().rstrip().endswith("</html>")


def signing(kills: int, draw: random.Random) -> bool:
    """Kill a review while it signs; whether anything was torn or lost, or the token told."""
    found: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as scratch:
        campaign = simulate_campaign(Path(scratch) / "campaign", duration_s=4.0)
        place = Path(scratch) / "place" / "result"
        save(process(campaign), place, report=False)
        before = {path.name: sha256(path) for path in place.iterdir()}
        duration_s = signed(place, None)[0]
        for _ in range(kills):
            shutil.rmtree(place.with_name("signed"), ignore_errors=True)
            _, told = signed(place, draw.uniform(0.0, duration_s))
            found["the token was told"] += told
            found["the reviewed result changed"] += before != {
                path.name: sha256(path) for path in place.iterdir()
            }
            kept = place.with_name(".ringmodal-review") / "result.jsonl"
            is_drafted = "set_aside" in (kept.read_text() if kept.exists() else "")
            if not place.with_name("signed").exists():
                found["no folder, the edit in the draft" if is_drafted else PARTIAL] += 1
            else:
                recover(place.with_name("signed"))
                edits = load(place.with_name("signed")).edits
                found["whole folder, signed" if len(edits) == 1 else PARTIAL] += 1
            kept.unlink(missing_ok=True)
    print(f"{kills} kills at random moments of a sign-off of {duration_s:.1f} s:\n")
    for what, count in sorted(found.items()):
        print(f"- {what}: {count}")
    return bool(found[PARTIAL] + found["the token was told"] + found["the reviewed result changed"])


def signed(place: Path, delay_s: float | None) -> tuple[float, bool]:
    """Sign a result with one edit, perhaps until a kill: seconds; whether the token was told."""
    with served(place) as (server, address, file):
        client = Client(address, file)
        state = client.settled("final")
        edit = {"kind": "set_aside", "pole": state["modes"][0]["pole"], "reason": "no partner"}
        client.ask("edit", revision=state["revision"], edit=edit)
        revision = client.settled("final")["revision"]
        sign = {"revision": revision, "by": "A. Keller", "note": "", "folder": "signed"}
        start = time.perf_counter()
        asking = threading.Thread(target=quietly, args=(client, sign))
        asking.start()
        if delay_s is None:
            asking.join()
            return time.perf_counter() - start, False
        time.sleep(delay_s)
        arguments = Path(f"/proc/{server.pid}/cmdline").read_text()
        server.kill()
        server.wait()
        asking.join()
        said = server.stdout.read() + server.stderr.read()
        return time.perf_counter() - start, client.token in said + arguments + address


def quietly(client: Client, sign: dict[str, Any]) -> None:
    """Ask for a signature; a server that was killed answers nothing."""
    with suppress(OSError, http.client.HTTPException):
        client.ask("sign", **sign)


def report(rows: list[tuple[bool, str, str, int]], duration_s: float, left_at_the_end: int) -> None:
    print(f"{len(rows)} kills at random moments of a process of {duration_s:.1f} s:\n")
    kinds = (NOTHING, OLD_STANDS, NEW_STANDS, PARTIAL)
    print("| killed while | place | " + " | ".join(kinds) + " |")
    print("|---|---|" + "---:|" * len(kinds))
    for stage in sorted({row[1] for row in rows}):
        for replacing in (False, True):
            counts = Counter(row[2] for row in rows if row[:2] == (replacing, stage))
            if counts:
                cells = " | ".join(str(counts[kind]) for kind in kinds)
                print(f"| {stage} | {'earlier result' if replacing else 'empty'} | {cells} |")
    most = max(row[3] for row in rows)
    print(
        f"\nHidden folders beside the place: {most} at most, {left_at_the_end} after one more run."
    )


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    main()
