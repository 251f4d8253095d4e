"""Values that hurt, and files changed with them: tables, documents, signals, checksums."""

from __future__ import annotations

import copy
import csv
import io
import json
import math
import os
import random
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from fuzz_files import mutate

from pipelines.storage.checksums import FILES, OWN, content_sha256, sealed, sha256

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


_ODD_SAMPLES = (0.0, 1.0, -1.0, np.nan, np.inf, -np.inf, 1e-320, 1e150, 1e160, 1e200, 1.7e308)
_ENCODINGS = ("utf-16", "utf-8-sig", "latin-1", "cp1252", "utf-32")


def strange(path: Path, kind: str) -> None:
    """Make something at a path that is no file."""
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "loop":
        path.symlink_to(path.name)
    elif kind == "dangling":
        path.symlink_to("not_there")
    elif kind == "folder":
        path.mkdir()


def edit_file(path: Path, rng: random.Random) -> None:
    """Change a file in the way of its kind, or as bytes."""
    if rng.random() < 0.2:
        path.write_bytes(spoiled(path.read_bytes(), rng))
        return
    try:
        if path.suffix == ".json":
            document = changed(json.loads(path.read_text()), rng)
            path.write_text(json.dumps(document))
        elif path.suffix == ".toml":
            document = changed(tomllib.loads(path.read_text()), rng)
            path.write_text(toml_text(document), errors="replace")
        elif path.suffix == ".csv":
            edit_csv(path, rng)
        elif path.suffix == ".parquet":
            _edit_parquet(path, rng)
        else:
            path.write_bytes(spoiled(path.read_bytes(), rng))
    except (ValueError, OSError, pa.ArrowException):  # spoiled before
        path.write_bytes(spoiled(path.read_bytes(), rng))


def spoiled(data: bytes, rng: random.Random) -> bytes:
    choice = rng.random()
    if choice < 0.1:
        return b""
    if choice < 0.2:
        return data.decode("utf-8", "replace").encode(rng.choice(_ENCODINGS), "replace")
    return mutate(data, rng, [data])


def edit_csv(path: Path, rng: random.Random) -> None:
    rows = list(csv.reader(io.StringIO(path.read_text())))
    for _ in range(rng.choice((1, 1, 2))):
        row = rng.choice(rows)
        choice = rng.random()
        if choice < 0.7 and row:
            row[rng.randrange(len(row))] = rng.choice((*BAD_NUMBERS, *ODD_TEXTS)).replace(
                "\udcff", ""
            )
        elif choice < 0.8:
            rows.remove(row)
        elif choice < 0.9:
            rows.append(row)
        else:
            row.append("1")
        if not rows:
            break
    out = io.StringIO()
    csv.writer(out).writerows(rows)
    path.write_text(out.getvalue())


def _edit_parquet(path: Path, rng: random.Random) -> None:
    table = pq.read_table(path)
    name = rng.choice(table.column_names)
    at = table.column_names.index(name)
    choice = rng.random()
    if choice < 0.5:
        values = table[name].to_numpy().copy()
        if values.dtype.kind in "fiu" and len(values):
            where = slice(None) if rng.random() < 0.3 else rng.randrange(len(values))
            values = values.astype(float) if rng.random() < 0.7 else values
            with np.errstate(all="ignore"):
                if rng.random() < 0.5:
                    values[where] = (
                        values[where] * rng.choice((-1, 0, 2, 1e3))
                        if values.dtype.kind == "f"
                        else 0
                    )
                elif values.dtype.kind == "f":
                    values[where] = rng.choice(_ODD_SAMPLES)
            table = table.set_column(at, name, pa.array(values))
        else:
            table = table.set_column(at, name, pa.array(["x"] * len(table)))
    elif choice < 0.6:
        table = table.drop_columns([name])
    elif choice < 0.7:
        table = table.slice(0, rng.randrange(len(table) + 1))
    elif choice < 0.8 and len(table):
        order = np.arange(len(table))
        rng.shuffle(order)
        table = table.take(pa.array(order))
    elif choice < 0.9:
        table = table.replace_schema_metadata(
            {
                k: rng.choice((b"0", b"-1", b"7", b"x", b"1000000000", b""))
                for k in table.schema.metadata or {}
            }
        )
    else:
        table = pa.concat_tables([table, table])
    pq.write_table(table, path)


def edit_tir(data: bytes, rng: random.Random) -> bytes:
    lines = data.decode().split("\r\n")
    for _ in range(rng.choice((1, 1, 2, 3))):
        at = rng.randrange(len(lines))
        choice = rng.random()
        if "=" in lines[at] and choice < 0.7:
            key, _, rest = lines[at].partition("=")
            value = rng.choice((*BAD_NUMBERS, "'x'", "''", "'inch'", "'psi'", "0.0", "-1.0"))
            lines[at] = f"{key}= {value} $" + rest.partition("$")[2]
        elif choice < 0.8:
            lines.insert(rng.randrange(len(lines)), lines[at])
        elif choice < 0.9:
            del lines[at]
        else:
            lines.insert(
                at, rng.choice(("[", "[]", "=", "= 1", "! x", "$", "MASS", "é = 1", "\x00"))
            )
        if not lines:
            return b""
    text = rng.choice(("\r\n", "\n")).join(lines)
    return text.encode(rng.choice(("utf-8", "utf-8", "latin-1", "utf-16", "utf-8-sig")), "replace")


def hurt(samples: np.ndarray, rng: random.Random) -> np.ndarray:
    """Samples of all channels, with the faults of hardware and of copies."""
    n_channels, n = samples.shape
    row, at = rng.randrange(n_channels), rng.randrange(n)
    choice = rng.randrange(11)
    with np.errstate(all="ignore"):
        if choice == 0:
            samples[row] = rng.choice(_ODD_SAMPLES)
        elif choice == 1:
            samples[row, at] = rng.choice(_ODD_SAMPLES)
        elif choice == 2:
            samples *= rng.choice((1e-300, 1e-160, 1e-20, 1e20, 1e150, 1e300))
        elif choice == 3:
            samples[row] *= rng.choice((0.0, -1.0, 2.0, 1e-12, 1e12, 1e160))
        elif choice == 4:
            samples = samples[:, : rng.choice((0, 1, 2, 3, 7, 8, 16, 31, 64, 1000))]
        elif choice == 5:
            samples[row] = samples[rng.randrange(n_channels)]
        elif choice == 6:
            samples[row, at:] = samples[row, at]
        elif choice == 7:
            samples = np.concatenate([samples, samples], axis=1)
        elif choice == 8:
            top = 0.2 * float(np.abs(samples[row]).max())
            samples[row] = samples[row].clip(-top, top)
        elif choice == 9:
            samples = np.roll(samples, rng.randrange(n), axis=1)
        else:
            samples[:] = samples[:, :1]
    return samples


def repair_checksums(folder: Path) -> None:
    """Let the checksums of a result fit its files again: the code behind them is reached."""
    tyre, marker = folder / "tyre.toml", folder / "provenance.json"
    if tyre.is_file() and not tyre.is_symlink():
        seal_again(tyre)
    if not marker.is_file():  # a pipe, maybe
        return
    try:
        record = json.loads(marker.read_text())
        files = record[FILES]
        files |= {name: sha256(folder / name) for name in files if (folder / name).is_file()}
        record[OWN] = content_sha256(record)
    except (OSError, ValueError, LookupError, TypeError):
        return
    marker.write_text(json.dumps(record, indent=2, ensure_ascii=False), errors="replace")


def seal_again(path: Path) -> None:
    """Give a parameter set, or a file of the library, the checksum of its new content."""
    try:
        document = tomllib.loads(path.read_text())
    except (OSError, ValueError):
        return
    origin, version = document.get("provenance"), document.get("version", document)
    if isinstance(origin, dict) and OWN in origin and "version" not in document:
        del origin[OWN]
        origin[OWN] = content_sha256(document)
        path.write_text(toml_text(document), errors="replace")
        return
    if isinstance(version, dict):
        version.pop("sha256", None)
    path.write_text(sealed(toml_text(document)), errors="replace")
