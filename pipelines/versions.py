"""Versions of what is installed, read from its metadata: nothing has to be loaded for that."""

from __future__ import annotations

import platform
from importlib.metadata import PackageNotFoundError, version

DISTRIBUTION = "ringmodal"
LIBRARIES = ("numpy", "scipy", "pandas", "pyarrow", "matplotlib", "pyuff")
UNKNOWN = "unknown"


def software_version() -> str:
    """Version of the installed distribution."""
    return installed_version(DISTRIBUTION)


def library_versions() -> dict[str, str]:
    """Versions of Python and of the libraries that numbers pass through."""
    python = {"python": platform.python_version()}
    return python | {name: installed_version(name) for name in LIBRARIES}


def installed_version(name: str) -> str:
    """Version of an installed distribution, ``"unknown"`` where there is none of that name."""
    try:
        return version(name)
    except PackageNotFoundError:
        return UNKNOWN
