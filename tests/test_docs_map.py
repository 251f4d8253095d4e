"""The documentation leads somewhere and leaves nothing out: links, commands, names, formulas."""

from __future__ import annotations

import importlib
import inspect
import json
import re
import shlex
import sys

import pyarrow.parquet as pq
import pytest
import typer
from docs_pages import ROOT, name_of, pages

import ema
import model
from pipelines.cli.app import app

sys.path.insert(0, str(ROOT / "docs" / "extensions"))

import command_pages

LINK = re.compile(r"!?\[[^\]]*\]\((?P<target>[^)\s]+)\)")
HEADING = re.compile(r"^#+ +(.+?) *$", re.MULTILINE)
LISTED = re.compile(r"^   (?P<name>\w[\w.]*)$", re.MULTILINE)
MODULE = re.compile(r"`((?:ema|model|pipelines)(?:/\w+)*/\w+\.py)`")


def all_commands():
    root = typer.main.get_command(app)
    context = root.make_context("ringmodal", [], resilient_parsing=True)
    return list(command_pages.commands(root, context))


COMMANDS = all_commands()


def anchor(heading: str) -> str:
    """The address of a heading, as GitHub and the generator form it."""
    kept = re.sub(r"[^\w\- ]", "", heading.replace("`", "").lower())
    return kept.strip().replace(" ", "-")


@pytest.mark.parametrize("page", pages(), ids=name_of)
def test_links_lead_somewhere(page):
    for found in LINK.finditer(page.read_text(encoding="utf-8")):
        target, _, place = found["target"].partition("#")
        if "://" in target or target.startswith("mailto:"):
            continue
        there = (page.parent / target).resolve() if target else page
        assert there.exists(), f"{name_of(page)}: {found['target']}"
        if place:
            headings = HEADING.findall(there.read_text(encoding="utf-8"))
            assert place in {anchor(each) for each in headings}, found["target"]


@pytest.mark.parametrize("page", pages(), ids=name_of)
def test_modules_named_exist(page):
    for module in MODULE.findall(page.read_text(encoding="utf-8")):
        assert (ROOT / module).is_file(), f"{name_of(page)}: {module}"


@pytest.mark.parametrize("name", [name for name, _, _ in COMMANDS])
def test_every_command_is_shown_outside_its_reference(name):
    guides = [page for page in pages() if "reference" not in page.parts]
    first, *rest = name.split()[1:]
    words = rf"ringmodal {first}\b" + (rf".*\b{rest[0]}\b" if rest else "")
    assert any(re.search(words, page.read_text(encoding="utf-8")) for page in guides)


@pytest.mark.parametrize(("name", "command"), [(name, command) for name, command, _ in COMMANDS])
def test_every_command_has_help_and_an_example_that_parses(name, command):
    prose, examples = command_pages.prose_and_examples(command.help or "")
    assert prose
    assert examples, f"{name} has no example"
    for example in examples:
        words = shlex.split(example.partition(" > ")[0])
        assert words[: len(name.split())] == name.split()
        command.make_context(name, words[len(name.split()) :])


@pytest.mark.parametrize("package", [ema, model], ids=lambda package: package.__name__)
def test_every_public_name_has_its_entry(package):
    page = (ROOT / "docs" / "api" / f"{package.__name__}.md").read_text(encoding="utf-8")
    assert sorted(LISTED.findall(page)) == sorted(package.__all__)


def listed_in_pipelines():
    page = (ROOT / "docs" / "api" / "pipelines.md").read_text(encoding="utf-8")
    names = LISTED.findall(page)
    return [name if "." in name else f"pipelines.plots.figures.{name}" for name in names]


@pytest.mark.parametrize(
    "path",
    [f"{p.__name__}.{name}" for p in (ema, model) for name in p.__all__] + listed_in_pipelines(),
)
def test_public_names_and_what_they_offer_have_docstrings(path):
    module, _, name = path.rpartition(".")
    found = getattr(importlib.import_module(module), name)
    assert inspect.getdoc(found)
    if inspect.isclass(found):
        own = [n for n in vars(found) if not n.startswith("_") and n not in fields_of(found)]
        assert [n for n in own if not inspect.getdoc(getattr(found, n))] == []


def fields_of(kind: type) -> set[str]:
    """Fields of a dataclass: its docstring describes them all, under Parameters or Attributes."""
    return set(getattr(kind, "__dataclass_fields__", ()))


def test_formulas_are_understood():
    latex = pytest.importorskip("mathml", reason="docutils, of the extra docs, is not installed")
    for page in pages():
        text = re.sub(r"```.*?```|`[^`\n]*`", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
        for block, inline in re.findall(r"\$\$(.+?)\$\$|\$(?!\s)([^$]+?)\$", text, re.DOTALL):
            assert latex.converted(block or inline, displayed=bool(block)).startswith("<math")


def test_what_needs_a_network_is_noticed():
    offline = pytest.importorskip("offline", reason="sphinx, of the extra docs, is not installed")
    own = '<script src="_static/a.js"></script><link rel="stylesheet" href="a.css" />'
    assert offline.fetched(own + '<a href="https://example.org">a link</a>') == []
    assert len(offline.fetched('<script async src="https://example.org/a.js"></script>')) == 1
    assert len(offline.fetched('<link rel="stylesheet" href="https://example.org/a.css">')) == 1


def headed(page: str, heading: str) -> str:
    """The section of a page under a heading that names something."""
    sections = re.split(r"^## ", page, flags=re.MULTILINE)
    return next(part for part in sections if heading in part.splitlines()[0])


def test_every_file_of_a_result_and_its_columns_are_described(sample_folder):
    page = (ROOT / "docs" / "reference" / "files.md").read_text(encoding="utf-8")
    for path in sample_folder.iterdir():
        section = headed(page, path.name)
        if path.suffix == ".csv":
            columns = path.read_text(encoding="utf-8").partition("\n")[0].split(",")
        elif path.suffix == ".parquet" and path.name != "residues.parquet":
            columns = pq.read_schema(path).names
        elif path.name == "provenance.json":
            columns = list(json.loads(path.read_text(encoding="utf-8")))
        else:
            continue
        assert [name for name in columns if f"`{name}`" not in section] == [], path.name
