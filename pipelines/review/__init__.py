"""The engineer's bench in the browser: results reviewed, edited and signed off."""

import lazy_loader  # type: ignore[import-untyped]

# What a folder or a rig needs takes as long to load as a result, whose page does not wait for it.
__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submodules=["folder", "watch"])
