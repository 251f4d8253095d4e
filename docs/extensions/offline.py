"""Check that pages can be read without a network: nothing is fetched from a host."""

from __future__ import annotations

import re
from pathlib import Path

from sphinx.application import Sphinx
from sphinx.util import logging

_logger = logging.getLogger(__name__)
_FETCHED = re.compile(
    r"<(?:script|img|iframe|source|video)\b[^>]*\ssrc=\"https?:[^\"]+\""
    r"|<link\b(?=[^>]*rel=\"(?:stylesheet|preload|icon)\")[^>]*\shref=\"https?:[^\"]+\""
)


def setup(app: Sphinx) -> dict[str, bool]:
    """Look through the pages once they are written."""
    app.connect("build-finished", _warn_of_hosts)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _warn_of_hosts(app: Sphinx, failure: Exception | None) -> None:
    if failure is not None or app.builder.format != "html":
        return
    for page in Path(app.outdir).rglob("*.html"):
        for found in fetched(page.read_text(encoding="utf-8")):
            _logger.warning("needs a network: %s", found, location=page.name)


def fetched(html: str) -> list[str]:
    """Parts of a page that a browser would load from a host."""
    return _FETCHED.findall(html)
