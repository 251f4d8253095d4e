"""Measurement: recordings become FRFs, FRFs become poles and modes with error bars."""

from ema.io.campaign import read_campaign

__all__ = ["read_campaign"]
