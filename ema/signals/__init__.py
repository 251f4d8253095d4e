"""From samples to frequency response functions, and what signals show of themselves."""
