"""Tables of thresholds, checks and simulated effects, from the classes that define them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields
from typing import TYPE_CHECKING

from ema.core.finding import Check
from ema.core.settings import CheckSettings, IdentificationSettings
from pipelines.simulate.laboratory_effects import describe_effects

if TYPE_CHECKING:
    from sphinx.application import Sphinx

PAGE = "dev/thresholds"
EFFECTS_PAGE = "howto/virtual-laboratory"
FILES_PAGE = "reference/files"
_TABLES = {"identification": IdentificationSettings, "checks": CheckSettings}


def setup(app: Sphinx) -> dict[str, bool]:
    """Append the tables to their pages as they are read."""
    app.connect("source-read", _append_tables)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _append_tables(app: Sphinx, page: str, source: list[str]) -> None:
    if page == PAGE:
        source[0] += "\n".join(tables())
    elif page == EFFECTS_PAGE:
        source[0] += "\n".join(effects_table())
    elif page == FILES_PAGE:
        source[0] += "\n".join(checks_table())


def tables() -> Iterator[str]:
    """One table for each class of settings."""
    for name, kind in _TABLES.items():
        yield f"\n## `[{name}]`\n"
        yield "| name | default | unit | effect | source |\n|---|---|---|---|---|"
        for each in fields(kind):
            about = each.metadata
            effect = about["effect"].replace("|", r"\|")
            cells = f"`{each.name}`", _shown(each.default), about["unit"], effect, about["source"]
            yield f"| {' | '.join(cells)} |"


def checks_table() -> Iterator[str]:
    """Checks by the names they have in ``quality.csv``."""
    yield "\n\n| check | about |\n|---|---|"
    for check in Check:
        yield f"| `{check}` | {check.meaning} |"


def effects_table() -> Iterator[str]:
    """Effects of a simulated laboratory."""
    yield "\n| name | default | unit | meaning |\n|---|---|---|---|"
    for name, default, unit, meaning in describe_effects():
        yield f"| `{name}` | {_shown(default)} | {unit} | {meaning} |"


def _shown(default: object) -> str:
    if isinstance(default, bool):
        return str(default).lower()
    return f"{default:g}" if isinstance(default, float) else f"{default}"
