"""Formats that are fuzzed, and where their seeds lie."""

from __future__ import annotations

from pathlib import Path

CORPUS = Path(__file__).resolve().parent / "fuzz_corpus"
BESIDE = "beside_manifest"  # the recordings that the manifests of the corpus name
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
