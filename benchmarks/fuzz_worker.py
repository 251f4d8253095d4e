"""Fuzz one format in one process, guided by coverage; started by fuzz.py, format by format.

Each input is written to a file and read as a campaign and by the inspection. Only errors of the
`InputError` family may leave them, no warning may be shown, and no input may reserve more than
four times its size: while it is read, the limit of the process's address space (RLIMIT_AS) stands
at what is in use, plus four times the input, plus 64 MB for libraries (buffers, stacks of threads).
An allocation beyond it fails, and that failure is kept like any other.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import json
import random
import resource
import shutil
import sys
import time
import traceback
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

import atheris
import pyarrow as pa
from fuzz_files import CORPUS, NAMES, beside, mutate

with atheris.instrument_imports(include=["ema", "pipelines", "pyuff", "nptdms", "tomllib"]):
    import nptdms  # noqa: F401  a reader loads it when needed, which is too late to instrument it
    import pyuff  # noqa: F401

    import ema
    from ema.core.errors import InputError
    from ema.io.uff.shape_sets import read_shapes
    from pipelines.prepare.inspection import inspect_files

FLOOR_BYTES = 64 << 20
FACTOR = 4
_LONGEST_INPUT_BYTES = 1 << 14
_PAGE = resource.getpagesize()
_MISTAKES = (TypeError, LookupError, ArithmeticError, AttributeError, RuntimeError)
_OURS = ("/ema/", "/pipelines/")


@contextlib.contextmanager
def limited_memory(size: int) -> Iterator[None]:
    """Let the process reserve so much more than it does now, and no more."""
    in_use = int(Path("/proc/self/statm").read_text().split()[0]) * _PAGE
    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (in_use + FLOOR_BYTES + FACTOR * size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (hard, hard))


def disguised_fault(error: BaseException) -> BaseException | None:
    """Find what is no fault of the file behind an error that says so.

    That is memory that ran out, and a mistake in our own lines where the errors of a library are
    taken for damage.
    """
    cause = error.__cause__
    if cause is None:
        return None
    if isinstance(cause, MemoryError) or "annot allocate" in str(cause):
        return cause
    raised_at = traceback.extract_tb(cause.__traceback__)[-1].filename
    if isinstance(cause, _MISTAKES) and any(part in raised_at for part in _OURS):
        return cause
    return disguised_fault(cause)


class Harness:
    """Reads inputs, keeps those that fail, and counts."""

    def __init__(self, kind: str, out: Path, folder: Path) -> None:
        self.kind = kind
        self.out = out
        self.path = folder / NAMES[kind]
        for path in beside(kind):
            shutil.copy(path, folder)
        self.executions = self.accepted = 0
        self.failures: dict[str, str] = {}
        self.started = self.reported = time.monotonic()

    def acts(self) -> list[Callable[[], object]]:
        """What is tried with the input."""
        if self.kind == "manifest":
            return [lambda: ema.read_campaign(self.path.parent)]
        shapes = [lambda: read_shapes(self.path)] if self.kind == "uff" else []
        return [
            *shapes,
            lambda: ema.read_campaign(self.path),
            lambda: self._inspect(levels=False),
            lambda: self._inspect(levels=True),
        ]

    def _inspect(self, *, levels: bool) -> None:
        for error in inspect_files([self.path], levels=levels).errors:
            raise error

    def __call__(self, data: bytes) -> None:
        """Read one input."""
        self.path.write_bytes(data)
        with limited_memory(len(data)):
            accepted = [self._attempt(data, act) for act in self.acts()]
        self.executions += 1
        self.accepted += accepted[-1]
        if time.monotonic() - self.reported > 1.0:
            self.report()

    def _attempt(self, data: bytes, act: Callable[[], object]) -> bool:
        try:
            act()
        except InputError as error:
            if (disguised := disguised_fault(error)) is not None:
                self._keep(data, disguised)
            return False
        except Exception as error:  # noqa: BLE001  what escapes is what is looked for
            self._keep(data, error)
            return False
        return True

    def _keep(self, data: bytes, error: BaseException) -> None:
        """Save the first input of each kind of failure: type and innermost line of ours."""
        frames = traceback.extract_tb(error.__traceback__)
        ours = [each for each in frames if any(part in each.filename for part in _OURS)]
        place = f"{Path(ours[-1].filename).name}:{ours[-1].lineno}" if ours else "elsewhere"
        key = f"{type(error).__name__} at {place}"
        if key in self.failures:
            return
        name = hashlib.sha256(data).hexdigest()[:12]
        self.failures[key] = name
        (self.out / f"{name}-{self.path.name}").write_bytes(data)
        text = "".join(traceback.format_exception(error))
        (self.out / f"{name}.txt").write_text(f"{key}\n{text}", errors="replace")
        self.report()

    def report(self) -> None:
        """Write the counts down; the process may end at any moment."""
        self.reported = time.monotonic()
        content = {
            "executions": self.executions,
            "accepted": self.accepted,
            "seconds": self.reported - self.started,
            "failures": self.failures,
        }
        (self.out / "counts.json").write_text(json.dumps(content, indent=1))


def mutator(seeds: list[bytes]) -> Callable[[bytes, int, int], bytes]:
    """Mutations by structure and by the fuzzer's own means, in turn."""

    def change(data: bytes, longest: int, seed: int) -> bytes:
        rng = random.Random(seed)
        if rng.random() < 0.4:
            return bytes(atheris.Mutate(data, longest))
        return mutate(data, rng, seeds)[:longest]

    return change


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("kind", choices=sorted(NAMES))
    parser.add_argument("--seconds", type=int, required=True)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--folder", type=Path, required=True, help="where inputs are written")
    asked = parser.parse_args()
    grown = asked.out / "corpus"
    grown.mkdir(parents=True, exist_ok=True)
    corpus = CORPUS / asked.kind
    seeds = [path.read_bytes() for path in sorted(corpus.iterdir())]
    pa.set_cpu_count(1)
    pa.set_io_thread_count(1)
    warnings.simplefilter("error")  # what is shown beside the result counts as a failure here
    harness = Harness(asked.kind, asked.out, asked.folder)
    # Libraries load, and threads start, before memory is looked at; any input may be a table.
    for seed in (*seeds, b"time,a\n0,1\n1,2\n"):
        harness.path.write_bytes(seed)
        for act in harness.acts():
            with contextlib.suppress(InputError):  # not every file makes a campaign by itself
                act()
    options = [
        sys.argv[0],
        f"-max_total_time={asked.seconds}",
        f"-seed={asked.seed}",
        f"-max_len={_LONGEST_INPUT_BYTES}",
        f"-artifact_prefix={asked.out}/crash-",
        "-timeout=15",
        "-rss_limit_mb=4096",
        "-verbosity=0",
        str(grown),
        str(corpus),
    ]
    atheris.Setup(options, harness, custom_mutator=mutator(seeds))
    atheris.Fuzz()


if __name__ == "__main__":
    main()
