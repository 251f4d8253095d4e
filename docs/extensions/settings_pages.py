"""The table of thresholds, from the settings classes themselves."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields
from typing import TYPE_CHECKING

from ema.core.settings import CheckSettings, IdentificationSettings

if TYPE_CHECKING:
    from sphinx.application import Sphinx

PAGE = "dev/thresholds"
_TABLES = {"identification": IdentificationSettings, "checks": CheckSettings}


def setup(app: Sphinx) -> dict[str, bool]:
    """Append the tables to the page of thresholds as it is read."""
    app.connect("source-read", _append_tables)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _append_tables(app: Sphinx, page: str, source: list[str]) -> None:
    if page == PAGE:
        source[0] += "\n".join(tables())


def tables() -> Iterator[str]:
    """One table for each class of settings."""
    for name, kind in _TABLES.items():
        yield f"\n## `[{name}]`\n"
        yield "| name | default | unit | effect | source |\n|---|---|---|---|---|"
        for each in fields(kind):
            about = each.metadata
            effect = about["effect"].replace("|", r"\|")
            cells = f"`{each.name}`", f"{each.default:g}", about["unit"], effect, about["source"]
            yield f"| {' | '.join(cells)} |"
