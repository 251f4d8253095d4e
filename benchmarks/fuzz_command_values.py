"""Values that hurt, and documents (TOML, JSON) changed at a random place."""

from __future__ import annotations

import copy
import json
import math
import random
from typing import Any

BAD_NUMBERS = (
    *("0", "-0", "1", "-1", "2", "3", "7", "0.5", "-0.25", "1e3", "1e6", "100000", "2147483648"),
    *("1e-300", "5e-324", "1e300", "1.8e308", "-1e308", "1e400", "nan", "inf", "-inf"),
    *("99999999999999999999", "1_000", "１２", "0x10", "1,5", "1.5.2", "+-1", "", " ", "abc", "1e"),
)
ODD_TEXTS = (
    *("", " ", "a", "0", "-", "--", "-x", ".", "..", "../..", "a/b", "a\\b", "~", "CON", "nul.txt"),
    *("Prüfstand", "轮胎", "\u202eabc", "a\u0000b", "\x1b[31mred\x1b[0m", "a\nb", "a\tb", "\udcff"),
    *(
        "=cmd|' /C calc'!A1",
        "@SUM(1)",
        "+1",
        "<script>alert(1)</script>",
        "{{ 7*7 }}",
        "%s%n",
        "$HOME",
    ),
    *("x" * 300, "y" * 5000, "[bold]x[/bold]", "[/]", "a'b\"c", "None", "true", "1=2", "=", "==1"),
)
_LEAVES: tuple[Any, ...] = (
    *(0, 1, -1, 2, 3, 72, 10**6, 2**31, 2**63 - 1, -(2**63), 10**30),
    *(0.0, -0.0, 0.5, -1.5, 1e-300, 5e-324, 1e154, 1e200, 1e308, -1e308),
    *(math.nan, math.inf, -math.inf, True, False, None),
    *(
        [],
        {},
        [1],
        [1.0, 2.0],
        ["a"],
        [[]],
        [None],
        {"a": 1},
        {"value": 1.0},
        [20.0, 260.0],
        [9.0, 1.0],
    ),
)
_FACTORS = (-1.0, 0.0, 0.5, 2.0, 1.01, 1e-6, 1e6, 1e150, 1e300)


def bad_leaf(rng: random.Random, was: Any = None) -> Any:
    """A value in place of another: scaled where it is a number, or any other one."""
    if isinstance(was, int | float) and not isinstance(was, bool) and rng.random() < 0.4:
        return was * rng.choice(_FACTORS) if abs(was) < 1e30 else 0.0
    if isinstance(was, str) and rng.random() < 0.3:
        return rng.choice((was.upper(), was + " ", was[:-1], was[::-1], was * 50, f" {was}"))
    if rng.random() < 0.4:
        return rng.choice(ODD_TEXTS).replace("\udcff", "ÿ")
    return copy.deepcopy(rng.choice(_LEAVES))


def changed(document: Any, rng: random.Random) -> Any:
    """The document with one to three entries replaced, removed, doubled, renamed or added."""
    document = copy.deepcopy(document)
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        holders = _holders(document)
        if holders:
            _change(rng.choice(holders), rng)
    return document


def _holders(node: Any) -> list[Any]:
    """All tables and lists of a document that hold something."""
    if not isinstance(node, dict | list) or not node:
        return []
    inner = node.values() if isinstance(node, dict) else node
    return [node, *(found for each in inner for found in _holders(each))]


def _change(holder: Any, rng: random.Random) -> None:
    keys = list(holder) if isinstance(holder, dict) else range(len(holder))
    key = rng.choice(keys)
    choice = rng.random()
    if choice < 0.65:
        holder[key] = bad_leaf(rng, holder[key])
    elif choice < 0.78:
        del holder[key]
    elif isinstance(holder, list):
        holder.insert(rng.randrange(len(holder) + 1), copy.deepcopy(holder[key]))
    elif choice < 0.88:
        holder[rng.choice((key + "_", key.upper(), "x", "", key[:-1]))] = holder.pop(key)
    else:
        holder[rng.choice(("x", "note", "std", "value", "é", "a b"))] = bad_leaf(rng)


def toml_text(document: dict[str, Any]) -> str:
    """A document as TOML; what TOML lacks (null) is left out."""
    lines = [f"{_key(k)} = {_toml(v)}" for k, v in document.items() if not _is_table(v)]
    for key, value in document.items():
        if isinstance(value, dict):
            lines += ["", f"[{_key(key)}]"]
            lines += [f"{_key(k)} = {_toml(v)}" for k, v in value.items() if v is not None]
        elif _is_table(value):
            for each in value:
                lines += ["", f"[[{_key(key)}]]"]
                lines += [f"{_key(k)} = {_toml(v)}" for k, v in each.items() if v is not None]
    return "\n".join(line for line in lines if not line.endswith(" = null")) + "\n"


def _is_table(value: Any) -> bool:
    if isinstance(value, dict):
        return True
    return isinstance(value, list) and bool(value) and all(isinstance(v, dict) for v in value)


def _key(name: str) -> str:
    return json.dumps(str(name), ensure_ascii=True)


def _toml(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if value is None:
        return "null"
    if isinstance(value, float):
        return str(value) if not math.isfinite(value) else repr(value)
    if isinstance(value, str):
        return json.dumps(value)
    if isinstance(value, list):
        return "[" + ", ".join(_toml(each) for each in value if each is not None) + "]"
    if isinstance(value, dict):
        inner = (f"{_key(k)} = {_toml(v)}" for k, v in value.items() if v is not None)
        return "{ " + ", ".join(inner) + " }"
    return str(value)  # an integer, a date
