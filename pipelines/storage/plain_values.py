"""pipelines.storage.plain_values."""

from __future__ import annotations

import math
from typing import Any


def plain(value: Any) -> Any:
    """Values as JSON has them: without NaN, infinity, dates and numpy's numbers."""
    if isinstance(value, dict):
        return {key: plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [plain(entry) for entry in value]
    if hasattr(value, "isoformat"):  # a date or time out of TOML
        return value.isoformat()
    if hasattr(value, "item"):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value
