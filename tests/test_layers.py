"""The structure: no import runs in a circle, whether inside a function or for typing only."""

import re
import tomllib

import grimp
import pytest
from docs_pages import ROOT, blocks_of

ARCHITECTURE = ROOT / "docs" / "dev" / "architecture.md"
PACKAGES = ("ema", "model", "pipelines", "ringmodal")


@pytest.fixture(scope="module")
def graph():
    return grimp.build_graph(*PACKAGES, cache_dir=None)


def circles(imports):
    """Modules that import each other, directly or through others (Tarjan 1972)."""
    number, lowest, stack, found = {}, {}, [], []

    def visit(module):
        number[module] = lowest[module] = len(number)
        stack.append(module)
        for other in imports(module):
            if other not in number:
                visit(other)
            if other in stack:
                lowest[module] = min(lowest[module], lowest[other])
        if lowest[module] == number[module]:
            circle = [stack.pop()]
            while circle[-1] != module:
                circle.append(stack.pop())
            if len(circle) > 1:
                found.append(sorted(circle))

    for module in imports(None):
        if module not in number:
            visit(module)
    return found


def test_circles_are_found():
    edges = {"a": ["b"], "b": ["c"], "c": ["b"], "d": []}
    assert circles(lambda m: list(edges) if m is None else edges[m]) == [["b", "c"]]


def test_no_module_imports_itself_through_others(graph):
    def imports(module):
        modules = graph.modules
        return modules if module is None else graph.find_modules_directly_imported_by(module)

    assert circles(imports) == []


def test_no_package_imports_itself_through_others(graph):
    def package(module):
        return ".".join(module.split(".")[:2])

    edges = {package(module): set() for module in graph.modules}
    for module in graph.modules:
        for other in graph.find_modules_directly_imported_by(module):
            edges[package(module)].add(package(other))
    for one, others in edges.items():
        others.discard(one)
        others -= set(PACKAGES)  # `import ema` for its names
    assert circles(lambda m: list(edges) if m is None else edges[m]) == []


def layers_of_contract(package):
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    contracts = settings["tool"]["importlinter"]["contracts"]
    return next(each["layers"] for each in contracts if each.get("containers") == [package])


@pytest.mark.parametrize(("package", "columns"), [("pipelines", (0, 45)), ("ema", (45, None))])
def test_the_picture_shows_the_layers(package, columns):
    picture = [block.text for block in blocks_of(ARCHITECTURE) if block.language == "text"][1]
    cells = [line[slice(*columns)] for line in picture.splitlines()[2:]]
    shown = [re.match(r"\w+(?: \| \w+)*", cell) for cell in cells if cell.strip()]
    assert [found[0] for found in shown] == layers_of_contract(package)


def test_every_package_is_described():
    page = ARCHITECTURE.read_text(encoding="utf-8")
    there = {
        path.parent.relative_to(ROOT).as_posix()
        for package in ("ema", "pipelines")
        for path in (ROOT / package).glob("*/__init__.py")
    }
    described = set(re.findall(r"^\| `((?:ema|pipelines)/\w+)` \|", page, re.MULTILINE))
    assert described == there
