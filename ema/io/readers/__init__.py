"""One module for each format of recordings; `ema.io.formats` finds them here by itself.

A module has ``SUFFIXES``, the endings that mark a file as a recording, ``read(path)``, which
returns a `FileContent`, and perhaps ``NAMED_SUFFIXES``: endings that are too common (``.txt``) to
take every such file of a folder for a recording, read where the user names the file. Libraries
that are slow to load are imported inside the functions.
"""
