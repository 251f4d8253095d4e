"""Core types and small tools."""
