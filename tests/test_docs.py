"""What the documentation shows works: snippets, commands, manifests.

Each page has a folder of its own and one Python namespace, from its first block to its last. What
its text names is there: ``sample_data/``, ``result/`` (the sample campaign's, unless the page makes
it) and ``measurements/`` (a folder with one campaign).
"""

from __future__ import annotations

import contextlib
import io
import re
import shlex
import shutil
import sys
import tomllib
from pathlib import Path

import pytest
from docs_pages import COMMANDS, Block, Command, blocks_of, commands_of, name_of, pages

from ema.io.campaign.manifest import Manifest, read_manifest
from pipelines.cli import main as cli
from pipelines.results.parameter_set import read_parameter_set

MOST_NOT_RUN = 12
ALL_BLOCKS = [block for page in pages() for block in blocks_of(page)]
SETTINGS = [block for block in ALL_BLOCKS if block.language == "toml"]
FRAME = re.compile(r"[─-╿]")


def is_run(block: Block) -> bool:
    return block.language == "python" or bool(block.language in COMMANDS and commands_of(block))


RUN = [page for page in pages() if any(is_run(block) for block in blocks_of(page))]


@pytest.fixture
def page_folder(tmp_path, sample_campaign, sample_folder, modes_once, monkeypatch):
    """A folder with everything that a page's blocks name."""

    def prepare(text: str) -> Path:
        there = {"sample_data": sample_campaign.parent, "measurements/tyre_1": sample_campaign}
        if "--out result\n" not in f"{text}\n" and "--out result " not in text:
            there["result"] = sample_folder
        for name, source in there.items():
            if name.partition("/")[0] in text:
                shutil.copytree(source, tmp_path / name)
        monkeypatch.chdir(tmp_path)
        monkeypatch.setenv("COLUMNS", "100")
        monkeypatch.setenv("MPLBACKEND", "Agg")
        return tmp_path

    return prepare


@pytest.mark.parametrize("page", RUN, ids=name_of)
def test_every_block_of_a_page_runs(page, page_folder, monkeypatch):
    blocks = [block for block in blocks_of(page) if is_run(block) and not block.reason]
    page_folder("\n".join(block.text for block in blocks))
    namespace = {"__name__": "__main__"}
    for block in blocks:
        if block.language == "python":
            lines_above = "\n" * (block.line - 1)
            code = compile(lines_above + block.text, name_of(page), "exec")
            with contextlib.redirect_stdout(io.StringIO()):
                exec(code, namespace)
        else:
            for command in commands_of(block):
                carry_out(command, f"{name_of(page)}, line {block.line}", monkeypatch)


def carry_out(command: Command, place: str, monkeypatch) -> None:
    """Run a command of the program in this process; other programs' commands are passed over."""
    text, _, target = command.text.partition(" > ")
    words = shlex.split(text, comments=True)
    if words[:1] == ["cd"]:
        monkeypatch.chdir(words[1])
    if words[:1] != ["ringmodal"]:
        return
    arguments = [found for word in words[1:] for found in expanded(word)]
    code, output = answer_to(arguments, monkeypatch)
    assert code == 0, f"{place}: {command.text}\n{output}"
    if target:
        Path(target.strip()).write_text(output, encoding="utf-8")
    missing = set(words_of(command.shown)) - set(words_of(output))
    assert not missing, f"{place}: {command.text}\nshown, but not said: {sorted(missing)}\n{output}"


def expanded(word: str) -> list[str]:
    """Files that a word with an asterisk stands for, as the shell would put them."""
    found = sorted(str(path) for path in Path().glob(word)) if "*" in word else []
    return found or [word]


def answer_to(arguments: list[str], monkeypatch) -> tuple[int, str]:
    said = io.StringIO()
    monkeypatch.setattr(sys, "argv", ["ringmodal", *arguments])
    with (
        contextlib.redirect_stdout(said),
        contextlib.redirect_stderr(said),
        pytest.raises(SystemExit) as ended,
    ):
        cli.main()
    return int(ended.value.code or 0), said.getvalue()


def words_of(text: str) -> list[str]:
    """Words without the lines of tables; "…" stands for what a page leaves out."""
    return [word for word in FRAME.sub(" ", text).split() if word != "…"]


def test_a_wrong_answer_is_noticed(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(AssertionError, match="not said"):
        carry_out(Command("ringmodal --help", "nobody says this"), "here", monkeypatch)
    with pytest.raises(AssertionError, match="here"):
        carry_out(Command("ringmodal process nowhere --out result", ""), "here", monkeypatch)


@pytest.mark.parametrize(
    "block", SETTINGS, ids=[f"{name_of(block.page)}:{block.line}" for block in SETTINGS]
)
def test_settings_are_accepted(block, tmp_path):
    """Manifests whole or in part, and parameter sets."""
    content = tomllib.loads(block.text)
    path = tmp_path / "shown.toml"
    keys = {field.alias or name for name, field in Manifest.model_fields.items()}
    if "ring" in content:
        path.write_text(block.text, encoding="utf-8")
        read_parameter_set(path)
    elif set(content) <= keys:
        schema = "" if "schema" in content else "schema = 1\n"
        runs = "" if "runs" in content else "\n[[runs]]\nfile = 'config_1.uff'\n"
        path.write_text(schema + block.text + runs, encoding="utf-8")
        read_manifest(path)


def test_what_is_not_run_has_a_reason():
    left_out = [block for block in ALL_BLOCKS if block.reason]
    assert all(len(block.reason.split()) >= 3 for block in left_out)
    assert len(left_out) <= MOST_NOT_RUN
