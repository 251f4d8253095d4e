"""Virtual campaigns and what the ring model answers."""
