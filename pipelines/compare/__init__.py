"""Results side by side: what changed, and whether noise explains it."""
