"""Figures as files and the report as PDF: what is written, what is refused, what it says."""

from __future__ import annotations

import re
import zlib
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.image import imread
from PIL import Image, ImageSequence
from results import structure_result, tyre_result

from ema.core.errors import InputError
from pipelines.report import write
from pipelines.report.page import PLAIN, Beside, Paragraph, Picture, Section, Table, drawings
from pipelines.report.write import report_sections, write_figures


@pytest.fixture(scope="module")
def structure():
    return structure_result()


@pytest.fixture(scope="module")
def written(structure, tmp_path_factory):
    return write_figures(structure, tmp_path_factory.mktemp("figures") / "new" / "folder")


def test_every_figure_of_the_report_is_written_in_both_formats(structure, written):
    names = [drawing.name for drawing in drawings(report_sections(structure))]
    assert [path.name for path in written] == [
        f"{name}.{ending}" for name in names for ending in ("png", "svg")
    ]
    assert "stability.png" in {path.name for path in written}
    assert sorted(written) == sorted(written[0].parent.iterdir())


def test_no_picture_is_blank_and_all_are_fine_enough_to_print(written):
    for path in written:
        if path.suffix == ".png":
            picture = imread(path)
            assert picture.shape[1] >= 1000  # 300 dots per inch at 8.5 cm
            assert np.ptp(picture[..., :3]) > 0.5


def test_texts_in_drawings_stay_texts(written):
    stability = next(path for path in written if path.name == "stability.svg")
    text = stability.read_text(encoding="utf-8")
    assert "frequency / Hz</text>" in text
    assert "model order</text>" in text


def test_names_of_the_figures_of_a_tyre_are_unique():
    names = [drawing.name for drawing in drawings(report_sections(tyre_result()))]
    assert len(set(names)) == len(names)
    assert {"coherence", "reference", "drive-point", "mac", "sensitivity"} <= set(names)


def only(monkeypatch, result, *anchors):
    """Write a short report."""
    chosen = tuple(each for each in report_sections(result) if each.anchor in anchors)
    assert len(chosen) == len(anchors)
    monkeypatch.setattr(write, "report_sections", lambda *_: chosen)


def test_existing_files_are_replaced_only_when_asked(structure, tmp_path, monkeypatch):
    only(monkeypatch, structure, "stability")
    (tmp_path / "stability.svg").write_text("mine")
    (tmp_path / "notes.txt").write_text("mine too")
    with pytest.raises(InputError, match=r"stability\.svg: .*--force"):
        write_figures(structure, tmp_path, ["svg"])
    assert {path.name for path in tmp_path.iterdir()} == {"stability.svg", "notes.txt"}
    write_figures(structure, tmp_path, ["svg"], force=True)
    assert (tmp_path / "stability.svg").read_text(encoding="utf-8").startswith("<?xml")
    assert (tmp_path / "notes.txt").read_text() == "mine too"


def test_an_unknown_format_is_refused(structure, tmp_path):
    with pytest.raises(InputError, match="'bmp'; known are png, svg"):
        write_figures(structure, tmp_path, ["bmp"])


def test_a_file_in_the_way_of_the_folder_is_named(structure, tmp_path):
    (tmp_path / "taken").write_text("")
    with pytest.raises(InputError, match=r"taken.*could not be written"):
        write_figures(structure, tmp_path / "taken" / "figures", ["svg"])


def test_the_pdf_holds_its_texts_and_leads_to_its_sections(structure, tmp_path, monkeypatch):
    try:
        write.printing_library("this test")
    except InputError as error:
        pytest.skip(str(error))
    only(monkeypatch, structure, "summary", "notes")
    name = "plate <b> (1)"
    target = write.write_pdf(replace(structure, name=name), tmp_path / "report.pdf")
    content = target.read_bytes()
    assert content.startswith(b"%PDF-")
    assert content.rstrip().endswith(b"%%EOF")
    assert [path.name for path in tmp_path.iterdir()] == ["report.pdf"]
    inside = content + b"".join(inflated(content))
    assert name.encode("utf-16-be").hex().encode() in inside
    for anchor in (b"summary", b"notes"):
        assert b"/Dest (" + anchor + b")" in inside


def inflated(content):
    """The compressed streams of a PDF as they were."""
    for stream in re.findall(rb"stream\r?\n(.*?)\r?\nendstream", content, re.DOTALL):
        with suppress(zlib.error):
            yield zlib.decompress(stream)


@pytest.mark.parametrize("missing", [ImportError("No module"), OSError("cannot load libpango-1.0")])
def test_a_missing_library_is_said_before_anything_is_computed(
    structure, tmp_path, monkeypatch, missing
):
    def fail(name):
        raise missing

    monkeypatch.setattr(write, "import_module", fail)
    with pytest.raises(InputError, match=r"weasyprint.*Windows.*MSYS2") as caught:
        write.write_pdf(structure, tmp_path / "report.pdf")
    assert str(missing) in str(caught.value)
    assert not list(tmp_path.iterdir())


def test_running_texts_are_texts(structure):
    hostile = '"; } body { display: none } /* \\ é'
    style = write._running_texts(
        replace(structure, name=hostile, provenance={"created": "2025-01-01T00:00:00+00:00"}), PLAIN
    )
    assert "display" not in style
    assert "body" not in style
    assert style.count('"') == 6
    assert "".join(f"\\{ord(c):06x}" for c in "2025-01-01") in style


def test_long_folded_tables_stay_on_the_screen():
    rows = tuple((str(k),) for k in range(40))
    tables = (
        Table("Long", ("a",), rows, folded=True),
        Table("Short", ("a",), rows[:5], folded=True),
        Table("Open", ("a",), rows),
    )
    blocks = write._for_paper(Section("some", "Some", tables)).blocks
    assert blocks[0] == Paragraph("Long: the 40 rows are in the HTML report.")
    assert blocks[1:] == tables[1:]


def test_a_wide_picture_stands_by_itself():
    wide, one, two = (
        Picture("data:,", name, name, wide=name == "wide") for name in ["wide", "one", "two"]
    )
    blocks = write._for_paper(Section("some", "Some", (Beside((wide, one)), Beside((two,))))).blocks
    assert blocks == (wide, Beside((one,)), Beside((two,)))
    assert write._for_paper(Section("some", "Some", (Beside((wide,)),))).blocks == (wide,)


def test_a_shape_moves_in_a_gif_and_the_rim_does_not(tmp_path):
    result = tyre_result()
    model = result.modal_model
    one = replace(result, modal_model=replace(model, modes=model.modes[1:2]))
    (path,) = write_figures(one, tmp_path, ["gif"])
    assert path.name == "shape-1.gif"
    with Image.open(path) as gif:
        assert gif.n_frames == 24
        assert gif.info["loop"] == 0
        frames = [
            np.asarray(frame.convert("L"), dtype=float) for frame in ImageSequence.Iterator(gif)
        ]
    assert np.abs(frames[12] - frames[0]).mean() > 5
    # At rest a quarter of a period later, whatever the direction.
    assert np.abs(frames[6] - frames[18]).mean() < 1
    assert write_figures(structure_result(), tmp_path, ["gif"]) == []
