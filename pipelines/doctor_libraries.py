"""Whether Python, the libraries and the optional parts are there, and nothing has their names."""

from __future__ import annotations

import platform
import sys
from importlib.metadata import PackageNotFoundError, metadata, requires
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from pipelines.doctor_check import ADVICE, OK, PROBLEM, Check
from pipelines.versions import DISTRIBUTION, UNKNOWN, installed_version

if TYPE_CHECKING:
    from packaging.requirements import Requirement

PARTS = {  # optional parts and what they are for
    "hdf5": "recordings in HDF5 and MATLAB v7.3",
    "tdms": "recordings in LabVIEW TDMS",
    "cluster": "batch on several cores or machines",
    "pdf": "the report as PDF",
}
IMPORT_NAMES = ("ema", "model", "pipelines")


def check_python() -> Check:
    """Python itself against what the package asks for."""
    from packaging.specifiers import SpecifierSet

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
    from packaging.requirements import Requirement

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
    home = Path(__file__).resolve().parents[1]
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
