"""Circumferential analysis: orders, ring modes and mass loading."""
