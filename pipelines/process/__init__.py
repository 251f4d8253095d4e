"""Processing: a campaign becomes modes, the modes become a ring."""

from pipelines.process.run import process, retune, tune

__all__ = ["process", "retune", "tune"]
