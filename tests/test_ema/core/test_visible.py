"""Texts from files act neither on a terminal nor in a spreadsheet."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ema.core.errors import escaped, inert, original, visible, visible_line
from ema.core.recording import ACCELERATION, Channel
from ema.io.campaign.read import read_file
from ema.io.text.csv import write_csv
from ema.io.uff.write import write_time_series

FORMULAS = ["=cmd|'/C calc'!A0", "@SUM(1)", "+1+1", "-1+1", "\t=1", " =1", '"=1"', "'=1", "=", "-"]
PLAIN = ["A01", "a=b", "225/55R17", "1-2", "", "'A'", "-1.2e-3", "+7", "-.5", "x\x00"]


@pytest.mark.parametrize("text", FORMULAS)
def test_what_starts_like_a_formula_gets_an_apostrophe(text):
    assert inert(text).startswith("'")
    assert original(inert(text)) == visible(text)


@pytest.mark.parametrize("text", PLAIN)
def test_other_texts_stay(text):
    assert inert(text) == visible(text)
    assert original(text) == text


@pytest.mark.parametrize("value", [None, 1, -1, -1.5e-3, np.float64(-2.0), True])
def test_what_is_no_text_stays(value):
    assert inert(value) is value


@given(st.text())
def test_nothing_acts_whatever_the_text(text):
    shown = visible(text)
    assert not any(sign < " " and sign not in "\t\n" for sign in shown)
    assert not any("\x7f" <= sign <= "\x9f" for sign in shown)
    shown.encode()
    assert visible_line(text).isprintable()
    assert str(inert(text))[:1] not in ("=", "@", "\t", "\r")


def test_what_acts_is_named():
    assert visible("a\x1b[31m\u202eb\x85\x7f") == "a[U+001B][31m[U+202E]b[U+0085][U+007F]"
    assert visible("°±é轮\tn\n") == "°±é轮\tn\n"


@given(st.text(st.characters(exclude_categories=["Cs"])))
def test_escaped_json_is_the_same_json(text):
    whole = escaped(json.dumps({"name": text}, ensure_ascii=False))
    assert json.loads(whole) == {"name": text}
    assert visible(whole) == whole


@pytest.mark.parametrize("name", ["=cmd|'/C calc'!A0", "@SUM(1)", "-A01", "'=x", "+"])
def test_a_table_of_samples_is_inert_and_read_back_under_the_same_name(tmp_path, name):
    samples = np.random.default_rng(1).normal(size=100)
    channels = [Channel(each, ACCELERATION, "m/s^2", samples) for each in (name, "A02")]
    path = tmp_path / "run.csv"
    write_csv(path, channels, 100.0)
    header = path.read_text().splitlines()[0].split(",")
    assert not any(cell.strip('" ').startswith(("=", "+", "-", "@")) for cell in header)
    assert read_file(path).recording.names == (name, "A02")


@pytest.mark.parametrize("binary", [True, False])
def test_a_universal_file_holds_no_control_characters(tmp_path, binary):
    samples = np.random.default_rng(1).normal(size=100)
    path = tmp_path / "run.uff"
    channel = Channel("A\x1b[31m\x9b\nB", ACCELERATION, "m/s^2", samples)
    write_time_series(path, [channel], 100.0, binary=binary)
    head = path.read_bytes().split(b"\n")[:13]
    assert not any(byte < 32 or 127 <= byte < 160 for line in head[:8] for byte in line)
    assert read_file(path).recording.n_samples == 100
