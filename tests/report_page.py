"""A report as a test reads it: its tags, its text and the data its charts draw from."""

import json
from base64 import b64decode
from html.parser import HTMLParser

import numpy as np

VOID = {"meta", "img", "br", "link", "input", "wbr"}


class Page(HTMLParser):
    """Tags of a page, and whether every one that opens also closes."""

    def __init__(self, html):
        super().__init__()
        self.open, self.tags, self.attributes, self.text, self.scripts = [], [], [], "", []
        self.feed(html)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] == "script":
            self.scripts.append(data)
        else:
            self.text += data

    def content(self, name):
        """What a block of the page draws from."""
        ids = [attributes.get("id") for tag, attributes in self.attributes if tag == "script"]
        return json.loads(self.scripts[ids.index(f"{name}-data")])


def decoded(packed, kind="<f4"):
    """Numbers that a page holds in base 64."""
    return np.frombuffer(b64decode(packed if kind == "<i2" else packed["bdata"]), kind)
