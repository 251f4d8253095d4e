"""The public face: its two lists agree, every name has an example, and every example runs."""

import ast
import doctest
import inspect
import shutil
import subprocess
import sys

import pytest
from docs_pages import ROOT

import ringmodal

NAMES = sorted(name for name in ringmodal.__all__ if name != "__version__")
FLAGS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE


METHODS = sorted(
    f"{name}.{method}"
    for name in NAMES
    if inspect.isclass(getattr(ringmodal, name))
    for method, found in vars(getattr(ringmodal, name)).items()
    if not method.startswith("_") and ">>>" in (inspect.getdoc(found) or "")
)


def examples_of(found, name):
    return doctest.DocTestParser().get_doctest(inspect.getdoc(found) or "", {}, name, None, 0)


@pytest.fixture(scope="module")
def examples_folder(tmp_path_factory, sample_campaign, sample_folder):
    """A folder with what the examples name: the sample campaign and its result."""
    folder = tmp_path_factory.mktemp("examples")
    shutil.copytree(sample_campaign, folder / "sample_data" / sample_campaign.name)
    shutil.copytree(sample_folder, folder / "result")
    return folder


def failures(test):
    said = []
    runner = doctest.DocTestRunner(optionflags=FLAGS, verbose=False)
    runner.run(test, out=said.append)
    return "".join(said)


@pytest.mark.parametrize("name", NAMES)
def test_the_example_of_a_public_name_runs(name, examples_folder, monkeypatch):
    monkeypatch.chdir(examples_folder)
    test = examples_of(getattr(ringmodal, name), name)
    assert test.examples, f"{name} has no example"
    assert not failures(test)


@pytest.mark.parametrize("path", METHODS)
def test_the_example_of_a_method_runs(path, examples_folder, monkeypatch):
    monkeypatch.chdir(examples_folder)
    name, method = path.split(".")
    assert not failures(examples_of(getattr(getattr(ringmodal, name), method), path))


def test_the_example_of_the_package_runs():
    test = examples_of(ringmodal, "ringmodal")
    assert test.examples
    assert not failures(test)


def test_a_wrong_example_is_noticed():
    assert failures(doctest.DocTestParser().get_doctest(">>> 1 + 1\n3\n", {}, "wrong", None, 0))


def test_the_stub_lists_what_the_package_offers():
    stub = ast.parse((ROOT / "ringmodal" / "__init__.pyi").read_text(encoding="utf-8"))
    imported = [node for node in stub.body if isinstance(node, ast.ImportFrom)]
    listed = {alias.name: node.module for node in imported for alias in node.names}
    assert listed == ringmodal._MODULE_OF


def test_the_package_runs_as_a_program():
    command = [sys.executable, "-m", "ringmodal", "--version"]
    said = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert said.splitlines()[0] == f"ringmodal {ringmodal.__version__}"
