"""Text tables in any dialect, and LabVIEW measurement files."""
