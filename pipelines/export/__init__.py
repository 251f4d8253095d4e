"""Modes, FRFs and ring parameters for other programs."""
