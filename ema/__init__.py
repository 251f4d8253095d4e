"""Measurement: recordings become FRFs, FRFs become poles and modes with error bars."""

import lazy_loader

# The names stand in __init__.pyi, loaded where first used: a command that needs little starts fast.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
