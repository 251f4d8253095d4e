"""Formats that are fuzzed, where their seeds lie, and how memory is kept countable."""

from __future__ import annotations

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
