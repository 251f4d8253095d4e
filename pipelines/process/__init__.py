"""Processing: a campaign becomes modes, the modes become a ring."""

from pipelines.process.refit import refit
from pipelines.process.ring import retune, tune, tune_ring
from pipelines.process.run import process

__all__ = ["process", "refit", "retune", "tune", "tune_ring"]
