"""Files of a simulation: whole or not at all, and the same bytes for the same numbers."""

import errno
import json

import numpy as np
import pytest

from ema.core.errors import InputError
from pipelines.cli.show_tyre import print_arrays, write_columns
from pipelines.plots.draw import write_figure
from pipelines.plots.figures import styled_figure

COLUMNS = {"frequency_hz": np.array([1.0, 2.5]), "order": np.array([1, 2])}


def test_a_table_that_fails_leaves_the_old_one(tmp_path, monkeypatch):
    path = tmp_path / "table.csv"
    path.write_text("old", encoding="utf-8")

    def full(partial, *_):
        partial.write_text("half", encoding="utf-8")
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("pipelines.storage.tables.write_csv", full)
    with pytest.raises(InputError, match="No space left on device"):
        write_columns(path, COLUMNS)
    assert [entry.name for entry in tmp_path.iterdir()] == ["table.csv"]
    assert path.read_text(encoding="utf-8") == "old"


def test_a_table_keeps_every_digit(tmp_path):
    path = tmp_path / "table.csv"
    write_columns(path, {"x": np.array([0.1 + 0.2]), "n": np.array([3])})
    assert path.read_text(encoding="utf-8") == "x,n\n0.30000000000000004,3\n"


@pytest.mark.parametrize("name", ["a.png", "a.svg", "a.SVG"])
def test_the_same_figure_gives_the_same_bytes(tmp_path, name):
    contents = []
    for folder in ("first", "second"):
        (tmp_path / folder).mkdir()
        with styled_figure(6, 5) as (figure, ax):
            ax.plot([0, 1], [2, 3])
        write_figure(tmp_path / folder / name, figure)
        contents.append((tmp_path / folder / name).read_bytes())
    assert contents[0] == contents[1]


def test_json_has_no_nan(capsys):
    print_arrays({"unit": "m/s²", "x": [1.0, np.nan, np.inf], "n": np.array([1]), "y": 2.5})
    printed = capsys.readouterr().out
    assert printed.isascii()  # which every console can show
    content = json.loads(printed, parse_constant=pytest.fail)
    assert content == {"unit": "m/s²", "x": [1.0, None, None], "n": [1], "y": 2.5}
