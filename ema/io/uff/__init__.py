"""Universal files: scanning, reading and writing datasets."""
