"""Reading of a campaign: manifest, channel roles, calibration and cross-run checks."""
