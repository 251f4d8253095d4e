"""Many processes add versions to one tyre, some are killed: ``library.py --writers 8 --each 50``.

First all writers add at the same time, through hard links and then as on a drive without them.
Then writers are ended by SIGKILL at random moments while others go on. Numbers must follow each
other without gap, every version must be whole, and a version whose number was told must be there.
"""

from __future__ import annotations

import argparse
import errno
import multiprocessing
import os
import random
import signal
import sys
import tempfile
import time
from collections import Counter
from multiprocessing.connection import Connection
from pathlib import Path

from pipelines.library import numbering
from pipelines.library.library import TyreLibrary

SOURCE = Path(__file__).parents[1] / "sample_data" / "tyre_225_55R17.toml"
LINKS, TURNS = "hard links", "no links: in turn"
KILLED_AT_ONCE, LONGEST_S = 4, 0.3


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--writers", type=int, default=8)
    parser.add_argument("--each", type=int, default=50)
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--folder", type=Path, help="On the drive to look at. Default: temporary.")
    chosen = parser.parse_args()
    faults = 0
    print("| numbers by | what happened | versions | gaps | damaged | lost | left over | s |")
    print("|---|---|---:|---:|---:|---:|---:|---:|")
    with tempfile.TemporaryDirectory(dir=chosen.folder) as scratch:
        TyreLibrary(Path(scratch) / "first").add(SOURCE)  # imports what every writer needs
        for means in (LINKS, TURNS):
            start_s = time.perf_counter()
            folder = Path(scratch) / f"all {means}"
            told = written_together(folder, means, chosen.writers, chosen.each)
            what = f"{chosen.writers} writers of {chosen.each}"
            faults += report(folder, means, what, told, start_s)
            start_s = time.perf_counter()
            folder = Path(scratch) / f"kills {means}"
            told = written_under_fire(folder, means, chosen.kills, random.Random(chosen.seed))
            faults += report(folder, means, f"{chosen.kills} kills", told, start_s)
    sys.exit(faults > 0)


def written_together(folder: Path, means: str, writers: int, each: int) -> list[int]:
    """Numbers that all writers were told."""
    running = [writer(folder, means, each) for _ in range(writers)]
    return [number for process, told in running for number in ended(process, told)]


def written_under_fire(folder: Path, means: str, kills: int, draw: random.Random) -> list[int]:
    """Numbers that writers were told of which each was killed at a random moment."""
    numbers: list[int] = []
    for _ in range(-(-kills // KILLED_AT_ONCE)):
        running = [writer(folder, means, 10**6) for _ in range(KILLED_AT_ONCE)]
        for process, told in running:
            time.sleep(draw.uniform(0.0, LONGEST_S))
            os.kill(process.pid or 0, signal.SIGKILL)
            numbers += ended(process, told)
    return numbers + ended(*writer(folder, means, 1))  # clears away what the killed ones left


def writer(
    folder: Path, means: str, each: int
) -> tuple[multiprocessing.process.BaseProcess, Connection]:
    here, there = multiprocessing.Pipe(duplex=False)
    process = multiprocessing.get_context("fork").Process(
        target=write, args=(folder, means, each, there)
    )
    process.start()
    there.close()
    return process, here


def write(folder: Path, means: str, each: int, told: Connection) -> None:
    if means == TURNS:
        os.link = without_links
        numbering.ABANDONED_S = 0.3
    for _ in range(each):
        told.send(TyreLibrary(folder).add(SOURCE, author=str(os.getpid())).number)


def without_links(*_: object) -> None:
    raise OSError(errno.EOPNOTSUPP, "no links on this drive")


def ended(process: multiprocessing.process.BaseProcess, told: Connection) -> list[int]:
    numbers = []
    try:
        while True:
            numbers.append(told.recv())
    except (EOFError, ConnectionError):
        process.join()
    return numbers


def report(folder: Path, means: str, what: str, told: list[int], start_s: float) -> int:
    """Print what is in the library; returns the number of faults."""
    duration_s = time.perf_counter() - start_s
    (tyre,) = TyreLibrary(folder).tyres()
    versions, damage = tyre.versions()
    found = {version.number for version in versions}
    missing = [error for error in damage if not Path(error.where).exists()]
    twice = sum(count - 1 for count in Counter(told).values())
    lost = len(set(told) - found) + twice
    left = sum(path.name.startswith(".") for path in tyre.path.iterdir())
    cells = (len(found), len(missing), len(damage) - len(missing), lost, left, f"{duration_s:.1f}")
    print(f"| {means} | {what} | {' | '.join(map(str, cells))} |", flush=True)
    return len(damage) + lost


if __name__ == "__main__":
    main()
