"""Curve fitting: poles and residues with uncertainties, and mode pairs."""
