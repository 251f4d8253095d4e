"""Tables of text in any dialect, and LabVIEW's."""
