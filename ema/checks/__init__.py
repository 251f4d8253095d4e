"""Checks on channels, sensors and runs."""
