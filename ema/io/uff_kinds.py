"""What the numbers of datasets and function types stand for."""

from __future__ import annotations

from collections.abc import Sequence

from ema.io.uff58_header import FREQUENCY_RESPONSE, TIME_RESPONSE
from ema.io.uff_scan import Dataset

SHAPES = (55, 2414)
_AROUND = (15, 18, 82, 151, 164, 1858, 2400, 2411, 2412, 2420)  # say nothing by themselves
_DATASETS = {
    15: "nodes",
    18: "coordinate systems",
    55: "data at nodes",
    56: "data at elements",
    57: "data at nodes of elements",
    82: "trace lines",
    151: "file header",
    164: "units",
    1858: "qualifiers of functions",
    2400: "model header",
    2411: "nodes",
    2412: "elements",
    2414: "analysis data",
    2420: "coordinate systems",
    2429: "groups",
    2467: "groups",
}
_FUNCTIONS = {
    0: "general or unknown",
    1: "time response",
    2: "auto spectrum",
    3: "cross spectrum",
    4: "frequency response",
    5: "transmissibility",
    6: "coherence",
    7: "auto correlation",
    8: "cross correlation",
    9: "power spectral density",
    10: "energy spectral density",
    11: "probability density",
    12: "spectrum",
    13: "cumulative frequency distribution",
    17: "orbit",
    18: "mode indicator function",
    19: "force pattern",
    20: "partial power",
    21: "partial coherence",
    24: "shock response spectrum",
    26: "multiple coherence",
    27: "order function",
}


def describe_left_out(datasets: Sequence[Dataset]) -> str:
    """Name what a file holds besides time series and FRFs; empty where nothing is lost by it.

    Geometry, units and headers are named only in a file that holds nothing else of use.
    """
    read = [each for each in datasets if _function(each) in (TIME_RESPONSE, FREQUENCY_RESPONSE)]
    left = [each for each in datasets if _function(each) not in (TIME_RESPONSE, FREQUENCY_RESPONSE)]
    if read:
        left = [each for each in left if each.number not in _AROUND]
    shapes = dict.fromkeys(_name(each) for each in left if each.number in SHAPES)
    others = dict.fromkeys(_name(each) for each in left if each.number not in SHAPES)
    parts = [f"{', '.join(others)}: nothing in it for this tool, left out"] if others else []
    if shapes:
        parts.append(f"{', '.join(shapes)}: left out; mode shapes are read by ema.read_shapes")
    return "; ".join(parts)


def _function(dataset: Dataset) -> int | None:
    return None if dataset.header is None else dataset.header.function_type


def _name(dataset: Dataset) -> str:
    function = _function(dataset)
    if function is not None:
        return f"function type {function} ({_FUNCTIONS.get(function, 'unknown')})"
    return f"dataset {dataset.number} ({_DATASETS.get(dataset.number, 'unknown')})"
