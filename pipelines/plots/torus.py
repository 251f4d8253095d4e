"""The tyre as a torus that moves with a mode, as a GIF: the drawing of the page's ``torus.js``."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw  # matplotlib requires it

from ema.core.modes import Mode
from pipelines.plots.style import PAPER

_AROUND, _ACROSS = 96, 14  # quads around the tyre and around its section
_SECTION, _WIDTH = 0.3, 1.25  # radius of the section in radii of the belt, and how it is widened
_TURN, _TILT, _DISTANCE = 0.62, 0.3, 7.0  # view in rad, and distance of the eye
_FRAMES, _FRAME_MS = 24, 80
_SIZE_PX, _OVERSAMPLED = 420, 2
_AMPLITUDE = 0.3  # largest deflection, in radii

Real = NDArray[np.float64]


def write_shape_gif(mode: Mode, position_deg: Real, path: Path) -> None:
    """Write one period of a mode on a closed circle of positions, which repeats for ever."""
    order = np.argsort(position_deg)
    even_deg = np.arange(_AROUND) * 360 / _AROUND
    shape = np.interp(even_deg, position_deg[order], mode.shape[order], period=360)
    phases = np.exp(2j * np.pi * np.arange(_FRAMES) / _FRAMES)
    frames = [_frame(_AMPLITUDE * (shape * phase).real) for phase in phases]
    more = {"save_all": True, "append_images": frames[1:], "duration": _FRAME_MS, "loop": 0}
    frames[0].save(path, format="gif", **more)


def _frame(deflection: Real) -> Image.Image:
    """The tyre with a deflection at even angles, seen from the side."""
    corners, share = _quads(deflection)
    across = corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]
    facing = across[0][:, 0] * across[1][:, 1] - across[0][:, 1] * across[1][:, 0]
    sizes = np.linalg.norm(across[0], axis=1) * np.linalg.norm(across[1], axis=1)
    light = np.clip(1.3 * facing / sizes, 0, 1)
    rubber, above, below = (_rgb(PAPER[name]) for name in ("--faint", "--ring", "--fitted"))
    part = np.clip(share / _AMPLITUDE, -1, 1)[:, None]
    tone = rubber + np.abs(part) * (np.where(part > 0, above, below) - rubber)
    shaded = 0.3 * tone + 0.7 * 0.45 * rubber
    colours = np.rint(shaded + light[:, None] * (tone - shaded)).astype(int)
    size = _SIZE_PX * _OVERSAMPLED
    picture = Image.new("RGB", (size, size), "white")
    pen, half = ImageDraw.Draw(picture), size / 2
    points = half + half / 1.55 * corners[:, :, :2]
    for k in np.argsort(corners[:, :, 2].sum(axis=1)):
        if facing[k] > 0:  # what faces away is hidden
            pen.polygon([tuple(p) for p in points[k].tolist()], fill=tuple(colours[k].tolist()))
    return picture.resize((_SIZE_PX, _SIZE_PX), Image.Resampling.LANCZOS)


def _quads(deflection: Real) -> tuple[Real, Real]:
    """Corners as seen, (n_quads, 4, 3) with the depth last, and the deflection of each quad."""
    around = 2 * np.pi * np.arange(_AROUND)[:, None] / _AROUND
    section = 2 * np.pi * np.arange(_ACROSS) / _ACROSS
    crown = (1 + np.cos(section)) / 2  # the tread moves, the rim does not
    radius = 1 - _SECTION + _SECTION * np.cos(section) + crown * deflection[:, None]
    x, y = radius * np.cos(around), radius * np.sin(around)
    z = np.broadcast_to(_WIDTH * _SECTION * np.sin(section), x.shape)
    right = x * np.cos(_TURN) + z * np.sin(_TURN)
    back = z * np.cos(_TURN) - x * np.sin(_TURN)
    up, near = y * np.cos(_TILT) - back * np.sin(_TILT), y * np.sin(_TILT) + back * np.cos(_TILT)
    scale = _DISTANCE / (_DISTANCE - near)
    seen = np.stack([right * scale, -up * scale, near], axis=-1)
    ahead = np.roll(seen, -1, axis=0)
    corners = np.stack([seen, ahead, np.roll(ahead, -1, axis=1), np.roll(seen, -1, axis=1)], axis=2)
    share = (deflection + np.roll(deflection, -1))[:, None] / 2 * crown
    return corners.reshape(-1, 4, 3), share.ravel()


def _rgb(colour: str) -> Real:
    return np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)], dtype=float)
