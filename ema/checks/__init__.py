"""Checks on channels, sensors and runs, and what they find."""
