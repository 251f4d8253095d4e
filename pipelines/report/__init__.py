"""The report: one HTML file, and its PDF."""

import lazy_loader  # type: ignore[import-untyped]

# Pages take as long to load as a result, which may be looked at before one is written.
__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submodules=["write"])
