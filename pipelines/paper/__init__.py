"""The tables and figures of the paper, next to the printed values."""
