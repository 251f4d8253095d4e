"""Campaign folders of the earlier failures: files and manifests as a laboratory hands them over."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

import ema
from ema.core.recording import FORCE, Channel
from ema.io.text.csv import write_csv
from ema.io.uff import dataset58_header as codes
from ema.io.uff.dataset58_header import Header58
from ema.io.uff.write import RADIAL, write_frfs, write_time_series
from pipelines.simulate.campaign import simulate_campaign
from pipelines.simulate.laboratory import Laboratory, LaboratoryMode, simulate_laboratory
from pipelines.simulate.laboratory_effects import Effects
from pipelines.simulate.truth import TruthMode, truth_modes

MANIFEST = "campaign.toml"
TIME_CONSTANT_S = 0.25  # of the window: adds 4 /s to decay rates of 10 to 40 /s
HIT_SHARE = 0.3  # of the highest force: the front of a hit …
HIT_DISTANCE_S = 0.5  # … this far behind the one before
FORCE_NODE = 999
_COHERENCE_TYPE = 6

Modes = tuple[LaboratoryMode, ...]


def laboratory(folder: Path, effects: Effects) -> Modes:
    """Universal files and manifest of the virtual laboratory."""
    simulate_laboratory(folder, effects)
    return Laboratory(effects).truth.modes


def split_sample(folder: Path, effects: Effects) -> Modes:
    """The tyre of the paper, clean, every order split by 0.1 %; the shaker somewhere in between."""
    between = float(np.random.default_rng(effects.seed).uniform(0.05, 0.95))
    of_pair = {"split_percent": 0.1, "shaker_between": between}
    simulate_campaign(
        folder, seed=effects.seed, duration_s=effects.duration_s, snr_db=effects.snr_db, **of_pair
    )
    return tuple(_as_laboratory_mode(mode) for mode in truth_modes(**of_pair))


def _as_laboratory_mode(mode: TruthMode) -> LaboratoryMode:
    strength = float(mode.shape(np.zeros(1))[0]) ** 2 / mode.modal_mass_kg
    shape = mode.shape(np.arange(72) * 5.0).astype(complex)
    of_pole = mode.frequency_hz, mode.damping_ratio
    return LaboratoryMode("ring", mode.order, 1.0, 1.0, *of_pole, strength, shape)


def tables_without_manifest(folder: Path, effects: Effects) -> Modes:
    """Text tables, which have no nodes, and no word on where the sensors were."""
    test = Laboratory(effects)
    folder.mkdir()
    for run in range(effects.runs):
        write_csv(folder / f"run_{run + 1}.csv", test.channels(run), effects.sampling_rate_hz)
    return test.truth.modes


def hits_behind_a_window(folder: Path, effects: Effects) -> Modes:
    """Responses behind an exponential window of the analyser that starts at each hit."""
    truth = laboratory(folder, effects)
    for run in range(effects.runs):
        channels = Laboratory(effects).channels(run)
        (force,) = (each for each in channels if each.quantity == FORCE)
        window = _window(force.samples, effects.sampling_rate_hz)
        behind = [each if each is force else _times(each, window) for each in channels]
        write_time_series(folder / f"run_{run + 1}.uff", behind, effects.sampling_rate_hz)
    return truth


def _window(force: np.ndarray, rate_hz: float) -> np.ndarray:
    loud = np.flatnonzero(force > HIT_SHARE * force.max())
    fronts = loud[np.diff(loud, prepend=-force.size) > HIT_DISTANCE_S * rate_hz]
    now = np.arange(force.size)
    last = fronts[np.maximum(np.searchsorted(fronts, now, side="right") - 1, 0)]
    return np.asarray(np.exp(-np.maximum(now - last, 0) / rate_hz / TIME_CONSTANT_S))


def _times(channel: Channel, window: np.ndarray) -> Channel:
    return replace(channel, samples=(channel.samples * window).astype(np.float32))


def hits_behind_a_stated_window(folder: Path, effects: Effects) -> Modes:
    """The same, stated in the manifest."""
    truth = hits_behind_a_window(folder, effects)
    _state(folder, processing={"exponential_window_s": TIME_CONSTANT_S})
    return truth


def frfs_behind_a_stated_window(folder: Path, effects: Effects) -> Modes:
    """FRFs of an analyser that had the window on, stated in the manifest."""
    truth = hits_behind_a_window(folder, effects)
    _replace_by_frfs(folder, with_coherence=True)
    _state(folder, processing={"exponential_window_s": TIME_CONSTANT_S})
    return truth


def frfs_with_coherence(folder: Path, effects: Effects) -> Modes:
    """FRFs and coherence of an analyser in one universal file, its averages in the manifest."""
    truth = laboratory(folder, effects)
    _replace_by_frfs(folder, with_coherence=True)
    return truth


def frfs_alone(folder: Path, effects: Effects) -> Modes:
    """FRFs of an analyser without coherence."""
    truth = laboratory(folder, effects)
    _replace_by_frfs(folder, with_coherence=False)
    return truth


def _replace_by_frfs(folder: Path, *, with_coherence: bool) -> None:
    frf = ema.estimate_frf(ema.read_campaign(folder))
    for path in folder.glob("run_*.uff"):
        path.unlink()
    file = folder / "frf.uff"
    write_frfs(file, frf, reference_node=FORCE_NODE)
    if with_coherence:
        _append_coherence(file, frf)
    averages = {"averages": round(frf.n_effective)} if with_coherence else {}
    _state(folder, runs=[{"file": file.name}], processing=averages)


def _append_coherence(file: Path, frf: ema.FRF) -> None:
    """One dataset 58b of function type 6 for each FRF."""
    lines = frf.frequency_hz
    with file.open("ab") as out:
        for node, values in zip(frf.node.tolist(), frf.coherence, strict=True):
            payload = np.nan_to_num(values).astype("<f8")
            header = Header58(
                id_lines=("Coherence", "NONE", "NONE", "NONE", "NONE"),
                function_type=_COHERENCE_TYPE,
                ordinate=codes.REAL_DOUBLE,
                n_values=payload.size,
                abscissa_min=float(lines[0]),
                abscissa_step=f"{lines[1] - lines[0]:.6E}",
                response_node=node,
                response_direction=RADIAL,
                reference_node=FORCE_NODE,
                reference_direction=RADIAL,
                abscissa=codes.Axis(codes.DATA_FREQUENCY, label="Frequency", unit="Hz"),
                ordinate_axis=codes.Axis(0, label="Coherence", unit="NONE"),
                binary=True,
                byte_order=codes.LITTLE_ENDIAN,
                n_bytes=payload.nbytes,
            )
            out.write(codes.format_header(header) + payload.tobytes() + codes.DELIMITER + b"\n")


def _state(folder: Path, **tables: Any) -> None:
    """Write tables of the manifest; `processing` is added to what is there."""
    path = folder / MANIFEST
    content = tomllib.loads(path.read_text(encoding="utf-8"))
    tables["processing"] = content.get("processing", {}) | tables.get("processing", {})
    path.write_text(tomlkit.dumps(content | tables), encoding="utf-8")
