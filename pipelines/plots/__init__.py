"""Plots: what is drawn, once for the page and once for files."""
