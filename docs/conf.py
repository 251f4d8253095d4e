"""Configuration of the documentation: ``make docs``, or ``sphinx-build -W docs site``."""

import re
import sys
from importlib.metadata import version as version_of
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx

sys.path.insert(0, str(Path(__file__).parent / "extensions"))

project = "ringmodal"
author = "The ringmodal developers"
project_copyright = author
version = release = version_of("ringmodal")

extensions = [
    "myst_nb",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx_copybutton",
    "command_pages",
    "mathml",
    "offline",
    "settings_pages",
]
exclude_patterns = ["_build", "**.ipynb_checkpoints"]
templates_path = ["_templates"]

# Pages are Markdown; headings of two levels can be linked to, across pages as well.
myst_enable_extensions = ["dollarmath", "amsmath", "deflist", "attrs_inline"]
myst_heading_anchors = 3
# Notebooks carry their outputs; a test runs them afresh.
nb_execution_mode = "off"
# Languages that Pygments does not know need not be coloured.
suppress_warnings = ["misc.highlighting_failure"]

# Docstrings name types and units themselves: signatures stay short.
autosummary_generate = True
autodoc_typehints = "none"
autodoc_member_order = "bysource"
numpydoc_show_class_members = False
default_role = "py:obj"

html_theme = "furo"
html_title = f"ringmodal {release}"
html_static_path = ["_static"]
html_css_files = ["extra.css"]
html_show_sphinx = False
html_math_renderer = "mathml"
# A prompt is not copied, nor what the program answered.
copybutton_prompt_text = "$ "


def setup(app: Sphinx) -> None:
    """Read bars in docstrings as absolute values, not as substitutions."""
    app.connect("autodoc-process-docstring", _keep_bars)


def _keep_bars(app: Sphinx, kind: str, name: str, of: Any, options: Any, lines: list[str]) -> None:
    lines[:] = [re.sub(r"\|(\w+)\|", r"\\|\1\\|", line) for line in lines]
