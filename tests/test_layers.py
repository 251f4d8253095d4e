"""The structure: no import runs in a circle, whether inside a function or for typing only."""

import grimp
import pytest

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
