"""What a refit costs against the fit of all modes, and how far a preview is from the end.

    python benchmarks/refits.py --seconds 20

Prints one row of a Markdown table for each campaign and edit: CPU time of both stages over that of
`fit_modes`, and the largest difference of the preview in standard deviations.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

import ema
from ema import ChannelName, Edit, EditKind, PoleName, edit_cost, refit_modes
from ema.core.errors import FitError
from ema.core.frf import FRF
from ema.core.modes import Chosen, Mode
from ema.identify import Identification
from pipelines.simulate.campaign import simulate_campaign

BAND_HZ = (20.0, 260.0)
#: Options of `simulate_campaign`.
CAMPAIGNS: dict[str, dict[str, Any]] = {
    "plain": {},
    "noise 10 dB": {"snr_db": 10.0},
    "split 0.7 %": {"split_percent": 0.7},
    "split 1.5 %": {"split_percent": 1.5},
    "split 1 %, drift 0.3 %": {"split_percent": 1.0, "drift_percent": 0.3},
}
Answer = TypeVar("Answer")


def timed(call: Callable[[], Answer]) -> tuple[float, Answer]:
    """CPU seconds of a call, and its answer."""
    start = time.process_time()
    answer = call()
    return time.process_time() - start, answer


def campaigns(seconds: float) -> Iterator[tuple[str, FRF]]:
    """Virtual campaigns, one after the other."""
    for name, options in CAMPAIGNS.items():
        with tempfile.TemporaryDirectory() as folder:
            path = simulate_campaign(Path(folder) / "tyre", duration_s=seconds, **options)
            yield name, ema.estimate_frf(ema.read_campaign(path))


def edits_of(found: Identification) -> Iterator[tuple[str, Edit]]:
    """An edit of each kind that can be made."""
    modes, frf = found.model.modes, found.measured
    named = [PoleName(mode.frequency_hz, mode.damping_ratio) for mode in modes]
    channel = ChannelName(frf.channel[5], frf.run[5])
    yield "set aside", Edit(EditKind.SET_ASIDE, named[1])
    yield "no partners", Edit(EditKind.NO_PARTNERS)
    for mode, name in zip(modes, named, strict=True):
        if mode.order and not mode.member:
            yield "lock", Edit(EditKind.LOCK, name)
            moved = PoleName(1.002 * mode.frequency_hz, mode.damping_ratio)
            yield "start", Edit(EditKind.START, moved)
            yield from _picks(found, mode)
            break
    yield "channel out", Edit(EditKind.CHANNEL_OUT, channel=channel)
    yield "run out", Edit(EditKind.RUN_OUT, run=frf.run_names[2])


def _picks(found: Identification, mode: Mode) -> Iterator[tuple[str, Edit]]:
    """A pole near a mode, and one far from all."""
    diagram, modes_hz = found.diagram, found.model.frequencies_hz
    hz, highest = diagram.frequency_hz, diagram.model_order == diagram.model_order.max()
    beside = np.min(np.abs(hz[:, None] / modes_hz - 1), axis=1)
    near = (np.abs(hz / mode.frequency_hz - 1) < 0.02) & (beside > 0.003)
    far = highest & (beside > 0.03) & (hz > 1.2 * BAND_HZ[0]) & (hz < 0.95 * BAND_HZ[1])
    for label, chosen in ("pick near", near), ("pick far", far):
        for row in np.flatnonzero(chosen)[:1]:
            place = float(hz[row]), float(diagram.damping_ratio[row])
            name = PoleName(*place, None, int(diagram.model_order[row]))
            yield label, Edit(EditKind.PICK, name)


def away(preview: Identification, final: Identification) -> str:
    """Largest difference of the modes but picked ones, in standard deviations."""
    shown, there = (
        [mode for mode in found.model.modes if mode.chosen is not Chosen.PICKED]
        for found in (preview, final)
    )
    if [(m.order, m.member) for m in shown] != [(m.order, m.member) for m in there]:
        return "other rows"
    pairs = list(zip(shown, there, strict=True))
    hz = [abs(a.frequency_hz - b.frequency_hz) / b.frequency_std_hz for a, b in pairs]
    ratio = [abs(a.damping_ratio - b.damping_ratio) / b.damping_std for a, b in pairs]
    return f"{max(hz):.3f} / {max(ratio):.3f}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=20.0, help="duration of a run")
    seconds = parser.parse_args().seconds
    print("| campaign | edit | live | rest | in one | preview: f / ζ in σ | cost |")
    print("|---|---|---|---|---|---|---|")
    for name, frf in campaigns(seconds):
        found = ema.identify_modes(frf, BAND_HZ)
        whole, _ = timed(lambda: ema.fit_modes(found.frf, ema.select_poles(found.diagram)))  # noqa: B023
        for label, edit in edits_of(found):
            try:
                live, preview = timed(lambda: refit_modes(found, [edit], live=True))  # noqa: B023
                rest, final = timed(lambda: refit_modes(preview, [edit]))  # noqa: B023
                one, _ = timed(lambda: refit_modes(found, [edit]))  # noqa: B023
                cost, _ = timed(lambda: edit_cost(found, [edit]))  # noqa: B023
            except FitError as error:
                print(f"| {name} | {label} | {error} |")
                continue
            ratios = " | ".join(f"{each / whole:.2f}" for each in (live, rest, one))
            far = away(preview, final)
            print(f"| {name} | {label} | {ratios} | {far} | {cost / whole:.2f} |", flush=True)


if __name__ == "__main__":
    main()
