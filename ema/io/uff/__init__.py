"""Universal files: scan, datasets, and what is written for other programs."""
