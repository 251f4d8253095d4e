"""The template of a report: title, client, logo, texts and units, from a TOML file."""

from __future__ import annotations

import tomllib
from base64 import b64encode
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from ema.core.errors import InputError, unknown
from pipelines.results.options import Units

_IMAGES = {".png": "png", ".jpg": "jpeg", ".jpeg": "jpeg", ".svg": "svg+xml"}
_MOST_LOGO_BYTES = 500_000  # the page holds it: a logo is smaller than that
_KINDS: dict[str, tuple[type, str]] = {  # of values that are not texts
    "signatures": (list, "a list of texts"),
    "fields": (dict, "a table of texts"),
}
_OF_MANIFEST = ("report_number", "client")  # may differ from tyre to tyre: a key of [tyre] as well


@dataclass(frozen=True)
class Template:
    """What a laboratory adds to its reports; every key of the file is a field of this class."""

    title: str = "Modal report"  # above the name of the tyre
    report_number: str = ""
    client: str = ""
    laboratory: str = ""
    logo: str = ""  # path of a picture from the template's folder; a data URI once read
    introduction: str = ""  # after the summary
    closing: str = ""  # above the signatures
    signatures: tuple[str, ...] = ("Checked by",)  # a line for each, with date and signature
    units: Units = Units.LAB
    fields: Mapping[str, str] = field(default_factory=dict)  # more lines of the head

    @property
    def head(self) -> tuple[tuple[str, str], ...]:
        """Lines of the head: names and texts."""
        known = {
            "Report number": self.report_number,
            "Client": self.client,
            "Laboratory": self.laboratory,
        }
        return tuple((name, text) for name, text in {**known, **self.fields}.items() if text)

    def completed(self, details: Mapping[str, Any]) -> Template:
        """The template with what the manifest says of this tyre."""
        own = {name: str(details[name]) for name in _OF_MANIFEST if details.get(name)}
        return replace(self, **own)  # type: ignore[arg-type]


PLAIN = Template()


def read_template(path: Path | None, units: Units | None = None) -> Template:
    """Read a template, the plain one where there is none; `units` overrides its own."""
    template = PLAIN if path is None else _read(path)
    return template if units is None else replace(template, units=units)


def _read(path: Path) -> Template:
    try:
        content: dict[str, Any] = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        rule = "a template is a TOML file"
        raise InputError(f"template {path}", str(error), rule, "Correct it") from error
    known = [each.name for each in fields(Template)]
    for name, value in tuple(content.items()):
        where = f"template {path.name}, {name}"
        if name not in known:
            raise unknown(where, name, f"known keys are {', '.join(known)}", known)
        kind, what = _KINDS.get(name, (str, "text"))
        inside = list(value.values()) if isinstance(value, dict) else value
        texts = inside if isinstance(inside, list) else [inside]
        if not isinstance(content[name], kind) or not all(isinstance(each, str) for each in texts):
            raise InputError(where, repr(value), f"it must be {what}", "Correct it")
        if name == "signatures":
            content[name] = tuple(value)
        elif name == "units":
            content[name] = _units(where, value)
        elif name == "logo":
            content[name] = _picture(where, path.parent / value)
    return Template(**content)


def _units(where: str, text: str) -> Units:
    if text not in list(Units):
        raise unknown(where, text, f"it must be one of {', '.join(Units)}", list(Units))
    return Units(text)


def _picture(where: str, path: Path) -> str:
    """A picture as data URI."""
    kind = _IMAGES.get(path.suffix.lower())
    if kind is None:
        rule = f"a logo has the ending {', '.join(_IMAGES)}"
        raise InputError(where, path.name, rule, "Convert the picture")
    try:
        content = path.read_bytes()
    except OSError as error:
        rule = "a logo is a file, with its path from the template's folder"
        raise InputError(where, f"{path}: {error.strerror}", rule, "Correct the path") from error
    if len(content) > _MOST_LOGO_BYTES:
        found, rule = (
            f"{path.name} has {len(content)} bytes",
            f"at most {_MOST_LOGO_BYTES} are read",
        )
        raise InputError(where, found, rule, "Reduce the picture")
    return f"data:image/{kind};base64,{b64encode(content).decode('ascii')}"
