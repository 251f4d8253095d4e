"""The same work by pyuff, pyFRF and sdypy-EMA, with the true frequencies given to the last.

Run by speed.py as `python speed_peer.py FOLDER METHOD BLOCK STEP`.
"""

from __future__ import annotations

import contextlib
import io
import sys
import tomllib
from pathlib import Path

import numpy as np
import pyuff
from pyFRF import FRF
from sdypy import EMA

ORDER = {"lscf": 60, "lsce": 30}
RATE_HZ = 2000.0
BAND_HZ = (20.0, 296.0)  # beyond 260 Hz, so that no mode lies at the edge


def frfs(path: Path, block: int, step: int) -> tuple[np.ndarray, np.ndarray]:
    """Inertances of a run's sensors and their frequencies."""
    sets = pyuff.UFF(str(path)).read_sets()
    force = next(each for each in sets if each["ordinate_spec_data_type"] == 13)
    sensors = [each for each in sets if each is not force and each["id1"] != "REF"]
    estimate = FRF(
        int(RATE_HZ),
        exc=np.asarray(force["data"])[None, None, :],
        resp=np.array([each["data"] for each in sensors])[None, :, :],
        window="hann",
        fft_len=block,
        nperseg=block,
        noverlap=block - step,
    )
    values = estimate.get_FRF(frf_estimator="H1", frf_form="accelerance")[:, 0, :]
    return np.nan_to_num(values), estimate.get_f_axis()  # 0 Hz is not a number there


def main() -> None:
    folder, method, block, step = Path(sys.argv[1]), sys.argv[2], int(sys.argv[3]), int(sys.argv[4])
    runs = [frfs(path, block, step) for path in sorted(folder.glob("*.uff"))]
    lines_hz = runs[0][1]
    truth = tomllib.loads((folder / "truth.toml").read_text(encoding="utf-8"))
    frequencies_hz = [mode["frequency_hz"] for mode in truth["modes"]]
    true_hz = sorted(f for f in frequencies_hz if BAND_HZ[0] < f < 260.0)
    with contextlib.redirect_stderr(io.StringIO()):
        model = EMA.Model(
            np.concatenate([values for values, _ in runs]),
            lines_hz,
            lower=BAND_HZ[0] if method == "lscf" else 0.0,
            upper=BAND_HZ[1],
            pol_order_high=ORDER[method],
        )
        model.get_poles(method, show_progress=False)
        model.select_closest_poles(true_hz, f_window=6)
        model.get_constants()
    print(" ".join(f"{f:.3f}" for f in sorted(model.nat_freq)))


if __name__ == "__main__":
    main()
