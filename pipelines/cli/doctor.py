"""``ringmodal doctor``: versions, optional parts, machine, and a small campaign.

Numerical libraries are used in other processes only: one that cannot be loaded is a finding.
"""

from __future__ import annotations

import json
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import tomllib
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path
from typing import Annotated

import typer
from packaging.requirements import Requirement

from pipelines.cli.screen import print_table, shown
from pipelines.cli.streams import lacking
from pipelines.cli.terminal import echo, print_json

OK, ADVICE, PROBLEM = "ok", "advice", "problem"

_PARTS = {  # optional parts and what they are for
    "hdf5": "recordings in HDF5 and MATLAB v7.3",
    "tdms": "recordings in LabVIEW TDMS",
    "xlsx": "recordings and results in Excel workbooks",
    "cluster": "batch on several machines",
    "pdf": "the report as PDF",
    "review": "results in the browser",
}
_LEAST_MEMORY_BYTES = 1e9  # about what a large campaign takes
_LEAST_DISK_BYTES = 0.5e9
_PROOF_S = "4"  # length of the simulated runs
_PROOF_MODES = 7  # orders 1 to 7 are in the band
_PROOF_LIMIT = 0.005  # of a frequency; runs of 4 s come within a tenth of it


@dataclass(frozen=True)
class Check:
    """What was checked, the verdict, what was found, and what to do."""

    name: str
    verdict: str
    found: str
    remedy: str = ""


def doctor(
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the result as JSON on standard output.")
    ] = False,
) -> None:
    """Check the installation: libraries, optional parts, machine, and a small campaign.

    Ends with code 0 if there is no problem, with 1 otherwise; advice is not a problem.

    Example:
      ringmodal doctor
    """
    with shown(quiet=as_json) as progress:
        progress.stage("Checking the installation …")
        checks = examine()
    problems = sum(check.verdict == PROBLEM for check in checks)
    if as_json:
        print_json([asdict(check) for check in checks])
    else:
        head = ("check", "verdict", "found")
        rows = [(check.name, check.verdict, check.found) for check in checks]
        print_table("", head, rows, texts=head, folding=head[2:])
        for check in checks:
            if check.verdict != OK:
                echo(f"{check.verdict.capitalize()}: {check.name}: {check.remedy}")
        none = "No problem found: ringmodal can work here."
        echo(f"Problems: {problems}." if problems else none)
    if problems:
        raise typer.Exit(1)


def examine() -> list[Check]:
    """Check everything; the small campaign is tried only where all libraries are there."""
    checks = [Check("Python", OK, f"{platform.python_version()}, {sys.executable}")]
    try:
        checks += [*map(_installed, requirements("")), *map(check_part, _PARTS)]
    except PackageNotFoundError:
        remedy = "Run `pip install .` in the project's folder"
        checks.append(Check("ringmodal", PROBLEM, "not installed", remedy))
    checks += check_machine()
    if any(check.verdict == PROBLEM for check in checks):
        remedy = "Fix the problems above, then run `ringmodal doctor` again"
        return [*checks, Check("campaign", PROBLEM, "not tried", remedy)]
    try:
        return [*checks, check_linear_algebra(), check_campaign()]
    except RuntimeError as error:
        remedy = "Reinstall the library that is named, or report this line"
        return [*checks, Check("campaign", PROBLEM, str(error), remedy)]


def requirements(part: str) -> list[Requirement]:
    """Requirements of the package on this machine, or of one of its optional parts alone."""

    def applies(requirement: Requirement, extra: str) -> bool:
        return requirement.marker is None or requirement.marker.evaluate({"extra": extra})

    every = map(Requirement, requires("ringmodal") or ())
    return [each for each in every if applies(each, part) and not (part and applies(each, ""))]


def _installed(requirement: Requirement) -> Check:
    name, remedy = requirement.name, f'pip install "{requirement.name}{requirement.specifier}"'
    try:
        found = version(name)
    except PackageNotFoundError:
        return Check(name, PROBLEM, "not installed", remedy)
    if requirement.specifier.contains(found, prereleases=True):
        return Check(name, OK, found)
    return Check(name, PROBLEM, f"{found}, {requirement.specifier} required", remedy)


def check_part(part: str) -> Check:
    """Whether the libraries of an optional part are there, and how to add them."""
    found = list(map(_installed, requirements(part)))
    what = ", ".join(f"{check.name} {check.found}" for check in found)
    if all(check.verdict == OK for check in found):
        return Check(f"part {part}", OK, what)
    needed = " ".join(f'"{each.name}{each.specifier}"' for each in requirements(part))
    remedy = f"For {_PARTS[part]}: pip install {needed}"
    return Check(f"part {part}", ADVICE, what, remedy)


def check_machine() -> list[Check]:
    """Free memory, folders that must be writable, and the characters of the terminal."""
    memory, encoding = _free_memory_bytes(), sys.stdout.encoding or "ascii"
    found = "free memory unknown" if memory is None else f"{memory / 1e9:.1f} GB free"
    scarce = memory is not None and memory < _LEAST_MEMORY_BYTES
    missing = lacking(encoding)
    lacks = f"{encoding}, which lacks {missing}" if missing else encoding
    return [
        _advised("memory", found, "Close other programs before large campaigns", scarce),
        _folder("temporary folder", Path(tempfile.gettempdir())),
        _folder("current folder", Path.cwd()),
        _advised("terminal", lacks, "Set PYTHONIOENCODING=utf-8", bool(missing)),
    ]


def _advised(name: str, found: str, remedy: str, needed: bool) -> Check:
    return Check(name, ADVICE, found, remedy) if needed else Check(name, OK, found)


def _free_memory_bytes() -> float | None:
    """Memory available without swapping, where Linux reports it."""
    listing = Path("/proc/meminfo")
    lines = listing.read_text().splitlines() if listing.is_file() else []
    kilobytes = [line.split()[1] for line in lines if line.startswith("MemAvailable:")]
    return 1024.0 * int(kilobytes[0]) if kilobytes else None


def _folder(name: str, path: Path) -> Check:
    remedy = "Free some space there, or work in another folder"
    try:
        with tempfile.TemporaryFile(dir=path) as file:
            file.write(b"can be written")
        free_bytes = shutil.disk_usage(path).free
    except OSError as error:
        return Check(name, PROBLEM, f"{path}: {error.strerror}", remedy)
    found = f"{path}, {free_bytes / 1e9:.1f} GB free"
    return _advised(name, found, remedy, free_bytes < _LEAST_DISK_BYTES)


def check_campaign() -> Check:
    """Whether processing a simulated campaign gives the modes it was made with."""
    errors = campaign_errors()
    worst = max(errors, default=float("inf"))
    found = f"{len(errors)} modes of a simulated tyre found, each within {100 * worst:.2f} %"
    if len(errors) < _PROOF_MODES or worst > _PROOF_LIMIT:
        return Check("campaign", PROBLEM, found, "Please report it with this line")
    return Check("campaign", OK, found)


def campaign_errors() -> list[float]:
    """Relative frequency errors of a simulated campaign, processed by the command line."""
    with tempfile.TemporaryDirectory() as scratch:
        folder, result = f"{scratch}/campaign", f"{scratch}/result"
        _output("ringmodal", "simulate", "campaign", folder, "--duration-s", _PROOF_S)
        written = _output("ringmodal", "process", folder, "--out", result, "--no-report", "--json")
        truth = tomllib.loads(Path(folder, "truth.toml").read_text(encoding="utf-8"))
    known_hz = {mode["order"]: mode["frequency_hz"] for mode in truth["modes"]}
    modes = {mode["order"]: mode["frequency_hz"] for mode in json.loads(written)["modes"]}
    return [abs(hz / known_hz[order] - 1) for order, hz in modes.items() if order in known_hz]


def check_linear_algebra() -> Check:
    """The BLAS library that numpy uses, and how many threads it may use."""
    found = [
        f"{each['internal_api']} {each['version']}, threads: {each['num_threads']}"
        for each in json.loads(_output("threadpoolctl", "-i", "numpy"))
        if each["user_api"] == "blas"
    ]
    return Check("BLAS", OK, f"{'; '.join(found) or 'name unknown'}; {os.cpu_count()} cores")


def _output(module: str, *arguments: str) -> str:
    """Standard output of a module run as a program, so that a crash is reported as well."""
    program = [sys.executable, "-m", module, *arguments]
    ended = subprocess.run(
        program, capture_output=True, encoding="utf-8", errors="replace", check=False
    )
    if ended.returncode:
        reason = (ended.stderr.strip().splitlines() or [f"exit code {ended.returncode}"])[-1]
        raise RuntimeError(f"{module} {arguments[0]}: {reason}")
    return ended.stdout
