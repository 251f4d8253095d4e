"""Whether this installation can work: libraries, optional parts, the machine, a small campaign."""

from __future__ import annotations

import ctypes
import platform
import shutil
import struct
import sys
import tempfile
import tomllib
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, metadata, requires
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet
from threadpoolctl import threadpool_info

from ema.core.errors import FitError, InputError
from ema.core.numerics import available_cores, available_threads
from pipelines.cli.streams import lacking
from pipelines.cli.terminal import Column, print_json, print_table, say, screen
from pipelines.process.run import process
from pipelines.results.options import Options
from pipelines.results.provenance import DISTRIBUTION, UNKNOWN, installed_version
from pipelines.simulate.campaign import simulate_campaign

if TYPE_CHECKING:
    from packaging.requirements import Requirement

__all__ = ["ADVICE", "OK", "PROBLEM", "Check", "examine"]


def examine() -> list[Check]:
    """Look at everything, in the order in which one would fix it.

    Returns
    -------
    list of Check
        The machine and the small campaign are looked at only where no library is missing.
    """
    installed = [check_python(), *check_libraries(), *check_import_names()]
    checks = [*installed, *check_parts()]
    if any(check.verdict == PROBLEM for check in installed):
        remedy = "Fix the problems above, then run `ringmodal doctor` again"
        return [*checks, Check("campaign", PROBLEM, "not tried", remedy)]
    try:
        return [*checks, *_machine()]
    except ImportError as error:
        remedy = f"pip install --force-reinstall {(error.name or 'ringmodal').partition('.')[0]}"
        return [*checks, Check("loading", PROBLEM, str(error), remedy)]


def _machine() -> list[Check]:
    return [
        check_linear_algebra(),
        check_memory(),
        *check_folders(),
        check_terminal(),
        check_campaign(),
    ]


OK, ADVICE, PROBLEM = "ok", "advice", "problem"


@dataclass(frozen=True)
class Check:
    """One thing that was looked at.

    Parameters
    ----------
    name : str
        What.
    verdict : {"ok", "advice", "problem"}
    found : str
        What was found.
    remedy : str
        What to do; empty where all is well.
    """

    name: str
    verdict: str
    found: str
    remedy: str = ""


PARTS = {  # optional parts and what they are for
    "hdf5": "recordings in HDF5 and MATLAB v7.3",
    "tdms": "recordings in LabVIEW TDMS",
    "cluster": "batch on several cores or machines",
    "pdf": "the report as PDF",
}
IMPORT_NAMES = ("ema", "model", "pipelines")


def check_python() -> Check:
    """Python itself against what the package asks for."""
    version = platform.python_version()
    try:
        wanted = metadata(DISTRIBUTION)["Requires-Python"]
    except PackageNotFoundError:
        remedy = "Run `pip install .` in the project's folder"
        return Check("ringmodal", PROBLEM, "not installed, only found on the path", remedy)
    if version in SpecifierSet(wanted):
        return Check("Python", OK, f"{version}, {sys.executable}")
    return Check("Python", PROBLEM, version, f"Install Python {wanted}")


def check_libraries() -> list[Check]:
    """Each library that is always needed."""
    return [_installed(each) for each in _requirements("")]


def check_parts() -> list[Check]:
    """Each optional part: what it is for, and how to add it."""
    checks = []
    for part, purpose in PARTS.items():
        found = [_installed(each) for each in _requirements(part)]
        missing = [check for check in found if check.verdict != OK]
        if missing:
            remedy = f'For {purpose}: pip install "{DISTRIBUTION}[{part}]"'
            what = "; ".join(f"{check.name} {check.found}" for check in missing)
            checks.append(Check(f"part {part}", ADVICE, what, remedy))
        elif found:
            what = ", ".join(f"{check.name} {check.found}" for check in found)
            checks.append(Check(f"part {part}", OK, what))
    return checks


def _requirements(extra: str) -> list[Requirement]:
    """Requirements of the package, or of one of its optional parts alone."""
    try:
        everything = [Requirement(text) for text in requires(DISTRIBUTION) or ()]
    except PackageNotFoundError:
        return []
    return [
        each
        for each in everything
        if (each.marker is None and not extra)
        or (each.marker is not None and _only_in(each, extra))
    ]


def _only_in(requirement: Requirement, extra: str) -> bool:
    """Whether a requirement is one of `extra` on this machine; "" are those of no part."""
    assert requirement.marker is not None
    applies = requirement.marker.evaluate({"extra": extra})
    return applies and (not extra or not requirement.marker.evaluate({"extra": ""}))


def _installed(requirement: Requirement) -> Check:
    version = installed_version(requirement.name)
    remedy = f'pip install "{requirement.name}{requirement.specifier}"'
    if version == UNKNOWN:
        return Check(requirement.name, PROBLEM, "not installed", remedy)
    if not requirement.specifier.contains(version, prereleases=True):
        found = f"{version}, and {requirement.specifier} is needed"
        return Check(requirement.name, PROBLEM, found, remedy)
    return Check(requirement.name, OK, version)


def check_import_names() -> list[Check]:
    """Whether other packages have the import names of this one, which are short and generic."""
    home = Path(__file__).resolve().parents[2]
    checks = []
    for name in IMPORT_NAMES:
        others = [place for place in _places(name) if place.parent != home]
        if not others:
            continue
        taken = _imported_from(name)
        verdict = ADVICE if taken == home else PROBLEM
        checks.append(
            Check(
                f"name {name}",
                verdict,
                f"also at {', '.join(map(str, others))}; `import {name}` finds {taken / name}",
                "Install ringmodal into an environment of its own, or rename the other",
            )
        )
    return checks or [Check("names", OK, f"{', '.join(IMPORT_NAMES)} are from {home}")]


def _places(name: str) -> list[Path]:
    """Packages and modules of a name that Python could import."""
    found = []
    for entry in sys.path:
        folder = Path(entry or ".").resolve()
        candidates = (folder / name / "__init__.py", folder / f"{name}.py")
        found += [_package(path) for path in candidates if path.is_file()]
    return list(dict.fromkeys(found))


def _imported_from(name: str) -> Path:
    """Folder in which the package or module lies that ``import`` finds."""
    spec = find_spec(name)
    origin = None if spec is None else spec.origin
    return Path("nowhere") if origin is None else _package(Path(origin).resolve()).parent


def _package(source: Path) -> Path:
    """The package that a source file begins, or the file itself where it is a module."""
    return source.parent if source.stem == "__init__" else source


_LEAST_MEMORY_BYTES = 1e9  # a large campaign takes about as much
_LEAST_DISK_BYTES = 0.5e9
_PROOF_S = 4.0  # length of the simulated runs
_PROOF_MODES = 7  # orders 1 to 7 lie in the band
_PROOF_LIMIT = 0.005  # of a frequency; runs of 4 s come within a tenth of it


def check_linear_algebra() -> Check:
    """The library beneath numpy, and how many threads it may use."""
    found = [each for each in threadpool_info() if each["user_api"] == "blas"]
    threads = f"{available_threads()} of {available_cores()} cores"
    if not found:
        # Apple's own library tells nothing about itself.
        return Check("linear algebra", OK, f"a library that does not tell its name; {threads}")
    names = ", ".join(f"{each['internal_api']} {each['version']}" for each in found)
    return Check("linear algebra", OK, f"{names}; {threads}")


def check_memory() -> Check:
    """Memory that is free."""
    free_bytes = _free_memory_bytes()
    if free_bytes is None:
        return Check("memory", OK, "this system does not tell how much is free")
    found = f"{free_bytes / 1e9:.1f} GB free"
    if free_bytes < _LEAST_MEMORY_BYTES:
        return Check("memory", ADVICE, found, "Close other programs before large campaigns")
    return Check("memory", OK, found)


def _free_memory_bytes() -> float | None:
    """Memory that programs can have without others being written to disk; None if unknown."""
    listing = Path("/proc/meminfo")
    if listing.is_file():
        for line in listing.read_text().splitlines():
            if line.startswith("MemAvailable:"):
                return 1024.0 * int(line.split()[1])
    if sys.platform == "win32":
        status = ctypes.create_string_buffer(64)  # MEMORYSTATUSEX: its size first, then numbers
        struct.pack_into("<I", status, 0, 64)
        if ctypes.windll.kernel32.GlobalMemoryStatusEx(status):
            return float(struct.unpack_from("<Q", status, 16)[0])
    return None


def check_folders() -> list[Check]:
    """Whether the temporary and the current folder take files, and how many."""
    return [
        _folder("temporary folder", Path(tempfile.gettempdir())),
        _folder("current folder", Path.cwd()),
    ]


def _folder(name: str, path: Path) -> Check:
    remedy = "Free some space there, or work in another folder"
    try:
        with tempfile.TemporaryFile(dir=path) as file:
            file.write(b"can be written")
        free_bytes = shutil.disk_usage(path).free
    except OSError as error:
        return Check(name, PROBLEM, f"{path}: {error.strerror}", remedy)
    found = f"{path}, {free_bytes / 1e9:.1f} GB free"
    return (
        Check(name, OK, found)
        if free_bytes >= _LEAST_DISK_BYTES
        else Check(name, ADVICE, found, remedy)
    )


def check_terminal() -> Check:
    """Whether the terminal has the signs that results are written with."""
    encoding = sys.stdout.encoding or "ascii"
    missing = lacking(encoding)
    if not missing:
        return Check("terminal", OK, encoding)
    found = f"{encoding} lacks {len(missing)} signs of results; they are written otherwise"
    return Check("terminal", ADVICE, found, "Set PYTHONIOENCODING=utf-8, or use Windows Terminal")


def check_campaign() -> Check:
    """Whether a simulated campaign comes back as the modes it was made with."""
    remedy = "Please report it with this line"
    try:
        with tempfile.TemporaryDirectory() as scratch:
            folder = simulate_campaign(Path(scratch) / "campaign", duration_s=_PROOF_S)
            truth = tomllib.loads((folder / "truth.toml").read_text(encoding="utf-8"))
            modes = process(folder, Options(tune=False)).modal_model.modes
    except (InputError, FitError, OSError) as error:
        return Check("campaign", PROBLEM, str(error), remedy)
    known_hz = {mode["order"]: mode["frequency_hz"] for mode in truth["modes"]}
    errors = [abs(m.frequency_hz / known_hz[m.order] - 1) for m in modes if m.order in known_hz]
    worst = max(errors, default=float("inf"))
    found = f"{len(errors)} modes of a simulated tyre found, each within {100 * worst:.2f} %"
    if len(errors) < _PROOF_MODES or worst > _PROOF_LIMIT:
        return Check("campaign", PROBLEM, found, remedy)
    return Check("campaign", OK, found)


def show_checks(checks: Sequence[Check], *, as_json: bool) -> None:
    """Print all checks, then what to do."""
    if as_json:
        print_json([asdict(check) for check in checks])
        return
    columns = [
        Column("check", [check.name for check in checks], is_text=True),
        Column("verdict", [check.verdict for check in checks], is_text=True),
        Column("found", [check.found for check in checks], is_text=True, folds=True),
    ]
    print_table(screen(), "", columns)
    for check in checks:
        if check.verdict != OK:
            say(f"{check.verdict.capitalize()}: {check.name}: {check.remedy}")
    problems = sum(check.verdict == PROBLEM for check in checks)
    say(f"Problems: {problems}." if problems else "No problem found: ringmodal can work here.")
