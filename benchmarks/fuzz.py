"""Fuzz the readers, guided by coverage: python benchmarks/fuzz.py --minutes 10 --format uff.

Needs atheris (pip install atheris; Linux). `fuzz_worker.py` says what counts as a failure. Failing
inputs are kept beside their traceback in `--out`, to be read again one by one; the corpus that
grew is kept there too, and the next run goes on from it.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from fuzz_files import NAMES, PLAIN_MEMORY

HERE = Path(__file__).resolve().parent
_MEMORY_DISK = "/dev/shm" if Path("/dev/shm").is_dir() else None


def fuzz(kind: str, seconds: float, out: Path, folder: str) -> dict[str, object]:
    """Fuzz one format; a worker that dies is a failure too, and another one goes on."""
    out.mkdir(parents=True, exist_ok=True)
    total: dict[str, float] = {"executions": 0, "accepted": 0, "seconds": 0.0}
    failures: dict[str, str] = {}
    deadline = time.monotonic() + seconds
    start = 0
    while (left := deadline - time.monotonic()) > 1.0:
        start += 1
        counts = out / "counts.json"
        counts.unlink(missing_ok=True)
        command = [sys.executable, str(HERE / "fuzz_worker.py"), kind, "--out", str(out)]
        command += [
            "--folder",
            folder,
            "--seconds",
            str(int(left)),
            "--seed",
            str(int(time.time())),
        ]
        environment = {**os.environ, **PLAIN_MEMORY, "PYTHONPATH": str(HERE.parent)}
        with (out / "log.txt").open("ab") as log:
            ended = subprocess.run(command, env=environment, stdout=log, stderr=log, check=False)
        found = json.loads(counts.read_text()) if counts.exists() else {}
        for key in total:
            total[key] += found.get(key, 0)
        failures |= found.get("failures", {})
        if ended.returncode:
            failures[f"worker {start} ended with {ended.returncode}"] = "log.txt"
            if not found:
                break
    return {**total, "failures": failures}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=10.0, help="for each format")
    parser.add_argument("--format", choices=[*NAMES, "all"], default="all")
    parser.add_argument("--out", type=Path, default=Path(tempfile.gettempdir()) / "ringmodal_fuzz")
    asked = parser.parse_args()
    failed = False
    for kind in NAMES if asked.format == "all" else [asked.format]:
        with tempfile.TemporaryDirectory(dir=_MEMORY_DISK) as folder:
            found = fuzz(kind, 60.0 * asked.minutes, asked.out / kind, folder)
        failed |= bool(found["failures"])
        print(
            f"{kind:9s} {found['executions']:9.0f} inputs in {found['seconds']:6.0f} s, "
            f"{found['accepted']:8.0f} read, {len(found['failures'])} kinds of failure",
            flush=True,
        )
        for key, name in found["failures"].items():
            print(f"          {key}: {asked.out / kind / name}")
    raise SystemExit(1 if failed else 0)


if __name__ == "__main__":
    main()
