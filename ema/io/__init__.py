"""Reading and writing of files: one module per format, behind `read_campaign`."""
