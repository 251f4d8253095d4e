"""Formats that are fuzzed, where their seeds lie, and ways to spoil a file."""

from __future__ import annotations

import gzip
import random
import re
import struct
import zlib
from collections.abc import Callable, Sequence
from pathlib import Path

CORPUS = Path(__file__).resolve().parent / "fuzz_corpus"
BESIDE = "beside_manifest"  # the recordings that the manifests of the corpus name
# One heap for all threads, and Arrow on it: what is reserved is what was asked for.
PLAIN_MEMORY = {
    "MALLOC_ARENA_MAX": "1",
    "ARROW_DEFAULT_MEMORY_POOL": "system",
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
}
# What an input is called, so that its reader takes it.
NAMES = {
    "uff": "input.uff",
    "csv": "input.csv",
    "gzip": "input.csv.gz",
    "lvm": "input.lvm",
    "parquet": "input.parquet",
    "feather": "input.feather",
    "matlab": "input.mat",
    "hdf5": "input.h5",
    "tdms": "input.tdms",
    "wav": "input.wav",
    "manifest": "campaign.toml",
}


def beside(kind: str) -> list[Path]:
    """Files that an input of this kind needs beside it."""
    return sorted((CORPUS / BESIDE).iterdir()) if kind == "manifest" else []


_NUMBER = re.compile(rb"[+-]?\d+(?:[.,]\d*)?(?:[eEdD][+-]?\d+)?")
_TEXTS = (
    b"0",
    b"-1",
    b"1",
    b"2",
    b"255",
    b"65536",
    b"2147483647",
    b"-2147483648",
    b"4294967296",
    b"9223372036854775807",
    b"1000000000000",
    b"1e400",
    b"-1e400",
    b"1e308",
    b"1e-320",
    b"nan",
    b"inf",
    b"-0.0",
    b"1,5",
    b"1.5D-03",
    b"1.5-103",
    b"0x10",
    b"1_000",
    b"",
)
_INTEGERS = (0, 1, 2, 3, 8, 127, 128, 255, 256, 32767, 65535, 2**20, 2**31 - 1, 2**31, 2**32 - 1)
_LONG_INTEGERS = (*_INTEGERS, 2**40, 2**62, 2**63 - 1, 2**64 - 1)

_WORDS = (
    (b"\n", b"\r\n"),
    (b"\n", b"\r"),
    (b"\r\n", b"\n"),
    (b"\n", b"\x00\n"),
    (b",", b";"),
    (b".", b","),
    (b" ", b"\t"),
    (b"E", b"D"),
    (b"[", b"("),
    (b'"', b""),
)

Mutation = Callable[[bytes, random.Random, Sequence[bytes]], bytes]


def mutate(data: bytes, rng: random.Random, seeds: Sequence[bytes]) -> bytes:
    """Apply one to three mutations; a gzip file is spoilt within as often as without."""
    inner = _unzipped(data) if rng.random() < 0.5 else None
    if inner is not None:
        return gzip.compress(mutate(inner, rng, seeds), 1)
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        data = rng.choice(MUTATIONS)(data, rng, seeds)
    return data


def _unzipped(data: bytes) -> bytes | None:
    if data[:2] != b"\x1f\x8b":
        return None
    try:
        return zlib.decompressobj(31).decompress(data, 1 << 20)
    except zlib.error:
        return None


def _span(data: bytes, rng: random.Random, longest: int = 400) -> tuple[int, int]:
    """A random stretch; whole lines half of the time."""
    start = rng.randrange(len(data) + 1)
    stop = min(len(data), start + rng.randrange(1, longest))
    if rng.random() < 0.5:
        start = data.rfind(b"\n", 0, start) + 1
        stop = data.find(b"\n", stop) + 1 or len(data)
    return start, stop


def truncate(data: bytes, rng: random.Random, seeds: Sequence[bytes]) -> bytes:
    """Cut the end off, at a line's end half of the time."""
    return data[: _span(data, rng)[0]]


def flip(data: bytes, rng: random.Random, seeds: Sequence[bytes]) -> bytes:
    """Change a few bytes."""
    changed = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 4, 16)) if data else 0):
        changed[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    return bytes(changed)


def remove(data: bytes, rng: random.Random, seeds: Sequence[bytes]) -> bytes:
    """Take a stretch out."""
    start, stop = _span(data, rng)
    return data[:start] + data[stop:]


def duplicate(data: bytes, rng: random.Random, seeds: Sequence[bytes]) -> bytes:
    """Repeat a stretch where it stands, or elsewhere."""
    start, stop = _span(data, rng)
    place = stop if rng.random() < 0.5 else _span(data, rng)[0]
    return data[:place] + data[start:stop] * rng.choice((1, 1, 2, 20)) + data[place:]


def splice(data: bytes, rng: random.Random, seeds: Sequence[bytes]) -> bytes:
    """Go on as another file does."""
    other = rng.choice(seeds)
    return data[: _span(data, rng)[0]] + other[_span(other, rng)[0] :]


def renumber(data: bytes, rng: random.Random, seeds: Sequence[bytes]) -> bytes:
    """Write another number in place of one, in its columns most of the time."""
    numbers = list(_NUMBER.finditer(data[: 1 << 14]))
    if not numbers:
        return flip(data, rng, seeds)
    # Headers come first, and one of their numbers does more than one of a thousand samples.
    chosen = numbers[min(int(rng.expovariate(0.05)), len(numbers) - 1)]
    text = rng.choice(_TEXTS)
    start, stop = chosen.span()
    if rng.random() < 0.7:
        blank = len(data[:start]) - len(data[:start].rstrip(b" "))
        start -= min(blank, max(len(text) - (stop - start), 0))
        text = text.rjust(stop - start)
    return data[:start] + text + data[stop:]


def reinteger(data: bytes, rng: random.Random, seeds: Sequence[bytes]) -> bytes:
    """Overwrite an aligned binary integer, either way round."""
    code = rng.choice("HIQ")
    width = struct.calcsize(f"<{code}")
    if len(data) < width:
        return flip(data, rng, seeds)
    place = rng.randrange(min(len(data), 1 << 14) - width + 1)
    place -= place % rng.choice((1, 2, width))
    value = rng.choice(_LONG_INTEGERS) % (1 << 8 * width)
    packed = struct.pack(rng.choice("<>") + code, value)
    return data[:place] + packed + data[place + width :]


def reword(data: bytes, rng: random.Random, seeds: Sequence[bytes]) -> bytes:
    """Change how lines end, how cells are separated, or how letters are stored."""
    old, new = rng.choice(_WORDS)
    choice = rng.randrange(4)
    if choice == 0:
        return data.decode("latin-1").encode(rng.choice(("utf-16", "utf-16-be", "utf-8-sig")))
    if choice == 1:
        return rng.choice((b"\xef\xbb\xbf", b"\xff\xfe", b"\n\n", bytes(16), b"# x\n")) + data
    return data.replace(old, new, rng.choice((1, 3, -1)))


MUTATIONS: tuple[Mutation, ...] = (
    truncate,
    flip,
    remove,
    duplicate,
    splice,
    renumber,
    renumber,
    reinteger,
    reword,
)
