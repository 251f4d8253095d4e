"""Files: written atomically, read back safely."""
