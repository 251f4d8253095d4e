"""Measurement: recordings become FRFs, FRFs become poles and modes with error bars."""
