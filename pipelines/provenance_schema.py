"""What ``provenance.json`` must hold where its checksum does not vouch for it."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from ema.errors import InputError


@dataclass(frozen=True)
class _Input:
    file: str
    bytes: int
    sha256: str


@dataclass(frozen=True)
class _Software:
    ringmodal: str


@dataclass(frozen=True)
class _Options:
    tune: bool
    objective: str
    given: dict[str, float]
    processing: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class _Provenance:
    software: _Software
    created: str
    campaign: str
    inputs: list[_Input]
    options: _Options
    stage_seconds: dict[str, float] = field(default_factory=dict)
    accepted_changes: dict[str, str] = field(default_factory=dict)


def require_provenance(path: Path, content: dict[str, Any]) -> None:
    """Refuse provenance from which no later stage can go on.

    Raises
    ------
    InputError
        If a part is missing or of another type; names it.
    """
    try:
        TypeAdapter(_Provenance).validate_python(content)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        where = ".".join(map(str, first["loc"]))
        rule = "later stages need what is told of the recordings and the options"
        raise InputError(
            f"{path}, {where}", first["msg"], rule, "Process the recordings again"
        ) from error
