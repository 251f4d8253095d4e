"""Pole estimation, stability diagram and pole selection."""
