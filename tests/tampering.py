"""A result folder tampered with: one file changed in one of many ways, drawn by a seed."""

from __future__ import annotations

import json
import math
import random
import tomllib
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import tomlkit

ODD_VALUES = (
    *(0, -1, 1, 2, 1.5, 1e308, -1e308, 1e-308, 1e30, 1e6, 2**63, 10**400, math.nan, math.inf),
    *(None, "", "abc", "1", True, [], {}, [1.0], [[1.0]], {"a": 1}),
)


def ways(path: Path) -> list[str]:
    """Ways to tamper with a file of this kind."""
    of_bytes = ["flipped", "truncated", "emptied", "deleted", "swapped", "doubled"]
    of_kind = {
        ".json": ["edited", "cut", "added"],
        ".toml": ["edited", "cut"],
        ".parquet": ["shuffled", "scaled", "odd", "shortened", "repeated", "renamed", "retyped"],
        ".csv": ["shuffled", "scaled"],
    }
    return of_bytes + of_kind.get(path.suffix, [])


def tamper(path: Path, way: str, other: Path, draw: random.Random) -> None:
    """Change a file; `other` is another result's folder."""
    if way in ("flipped", "truncated", "emptied", "deleted", "swapped", "doubled"):
        _bytes(path, way, other / path.name, draw)
    elif path.suffix == ".json":
        content = json.loads(path.read_text())
        _edit(content, way, draw)
        path.write_text(json.dumps(content))
    elif path.suffix == ".toml":
        content = tomllib.loads(path.read_text())
        _edit(content, way, draw, skip=(None, 2**63, 10**400))
        path.write_text(tomlkit.dumps(content))
    elif path.suffix == ".parquet":
        pq.write_table(_table(pq.read_table(path), way, draw), path)
    else:
        lines = path.read_text().splitlines()
        if way == "shuffled":
            lines[1:] = lines[:0:-1]
        else:
            lines = [line.replace("1", "2") for line in lines]
        path.write_text("\n".join(lines) + "\n")


def _bytes(path: Path, way: str, other: Path, draw: random.Random) -> None:
    content = bytearray(path.read_bytes())
    if way == "flipped":
        content[draw.randrange(len(content))] ^= 1 << draw.randrange(8)
    elif way == "truncated":
        content = content[: draw.randrange(1, len(content))]
    elif way == "emptied":
        content = bytearray()
    elif way == "doubled":
        content = content + content
    elif way == "swapped" and other.exists():
        content = bytearray(other.read_bytes())
    else:
        path.unlink()
        return
    path.write_bytes(content)


def _places(content: object) -> list[tuple[object, object]]:
    """All (container, key) pairs of nested content."""
    pairs = content.items() if isinstance(content, dict) else enumerate(content)
    found = []
    for key, value in list(pairs):
        found.append((content, key))
        if isinstance(value, dict | list):
            found += _places(value)
    return found


def _edit(content: object, way: str, draw: random.Random, skip: tuple[object, ...] = ()) -> None:
    container, key = _drawn_place(content, draw)
    if way == "edited":
        container[key] = draw.choice([value for value in ODD_VALUES if value not in skip])
    elif way == "cut":
        del container[key]
    elif isinstance(container, list):
        container.append(container[key])
    else:
        container["added"] = container[key]


def _drawn_place(content: object, draw: random.Random) -> tuple[object, object]:
    """A place, with keys near the top as likely as the many numbers far below."""
    container, key = content, draw.choice(list(content))
    while isinstance(container[key], dict | list) and container[key] and draw.random() < 0.8:
        container = container[key]
        keys = list(container) if isinstance(container, dict) else range(len(container))
        key = draw.choice(list(keys))
    return container, key


def _table(table: pa.Table, way: str, draw: random.Random) -> pa.Table:
    random_rows = np.random.default_rng(draw.randrange(2**32))
    name = draw.choice([name for name in table.column_names if _is_number(table[name])])
    at = table.column_names.index(name)
    values = table[name].to_numpy().copy()
    if way == "shuffled":
        return table.take(random_rows.permutation(table.num_rows))
    if way == "shortened":
        return table.slice(draw.randrange(2), table.num_rows - draw.randrange(1, table.num_rows))
    if way == "repeated":
        rows = np.arange(table.num_rows)
        rows[draw.randrange(len(rows))] = 0
        return table.take(rows)
    if way == "renamed":
        return table.rename_columns([*table.column_names[:at], "x", *table.column_names[at + 1 :]])
    if way == "retyped":
        return table.set_column(at, name, pa.array([str(value) for value in values]))
    if way == "scaled":
        return table.set_column(at, name, pa.array(values * 2))
    odd = draw.choice([value for value in ODD_VALUES if isinstance(value, float)])
    values = values.astype(float)
    values[draw.randrange(len(values)) if draw.random() < 0.5 else slice(None)] = odd
    return table.set_column(at, name, pa.array(values))


def _is_number(column: pa.ChunkedArray) -> bool:
    return pa.types.is_floating(column.type) or pa.types.is_integer(column.type)
