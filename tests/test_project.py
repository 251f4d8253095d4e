"""Files about the project agree: one version, one date, hooks and forms that parse."""

import re
import tomllib

import pytest
import yaml
from docs_pages import ROOT, name_of

FORMS = sorted((ROOT / ".github" / "ISSUE_TEMPLATE").glob("*.yml"))


def loaded(path):
    return yaml.safe_load(path.read_text(encoding="utf-8"))


def test_version_and_date_are_the_same_everywhere():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    citation = loaded(ROOT / "CITATION.cff")
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    latest = re.search(r"^## \[(\d[\w.]*)\] - (\d{4}-\d{2}-\d{2})$", changelog, re.MULTILINE)
    assert project["version"] == citation["version"] == latest[1]
    assert str(citation["date-released"]) == latest[2]
    assert citation["license"] == project["license"]


def test_hooks_are_those_of_the_checks():
    (repository,) = loaded(ROOT / ".pre-commit-config.yaml")["repos"]
    assert [hook["id"] for hook in repository["hooks"]] == ["ruff", "ruff-format"]


@pytest.mark.parametrize("form", FORMS, ids=name_of)
def test_forms_ask_for_something(form):
    content = loaded(form)
    assert content["name"] and content["description"]
    names = [field["id"] for field in content["body"]]
    assert len(set(names)) == len(names)
    assert all(field["attributes"]["label"] for field in content["body"])
    assert any(field.get("validations", {}).get("required") for field in content["body"])


def test_there_are_three_forms():
    assert [form.stem for form in FORMS] == ["bug", "file_not_read", "wrong_number"]
