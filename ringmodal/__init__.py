"""Experimental modal analysis of tyres: from recordings to modes, ring parameters and a report.

>>> import ringmodal as rm
>>> ring = rm.RingParameters(
...     mean_radius_m=0.33,
...     mass_per_area_kg_m2=19.69,
...     radial_stiffness_n_m3=8.27e6,
...     circumferential_stiffness_n_m3=6.56e5,
...     axial_stiffness_n_m=2.52e7,
...     bending_stiffness_n_m=7.45,
...     inflation_pressure_pa=2.2e5,
... )
>>> [f"{f:.1f} Hz" for f in rm.natural_frequencies_hz(ring, [2, 3])]
['100.7 Hz', '122.4 Hz']

The names come from `ema` (measurement), `model` (ring) and `pipelines` (whole campaigns). They are
listed in ``__init__.pyi`` and load where they are first used.
"""

from __future__ import annotations

import ast
from importlib import import_module
from pathlib import Path
from typing import Any

_STUB = ast.parse(Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
_IMPORTS = [statement for statement in _STUB.body if isinstance(statement, ast.ImportFrom)]
_MODULE_OF = {alias.name: str(each.module) for each in _IMPORTS for alias in each.names}

__all__ = [*_MODULE_OF, "__version__"]  # noqa: PLE0604


def __getattr__(name: str) -> Any:
    if name == "__version__":
        return import_module("importlib.metadata").version("ringmodal")  # 25 ms to load
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'ringmodal' has no attribute {name!r}")
    return getattr(import_module(_MODULE_OF[name]), name)


def __dir__() -> list[str]:
    return __all__
