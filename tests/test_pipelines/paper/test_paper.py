"""The paper reproduced: its tables to the digits known, its claims with the right verdicts."""

import csv
import re
from dataclasses import replace

import numpy as np
import pytest

from ema.core.errors import InputError
from model import bifurcation, natural_frequencies_hz, wave_pair
from model.parameters import TABLE_3_FREQUENCIES_HZ, TABLE_3_ORDERS, TABLE_4_RING
from pipelines.paper import reproduce as paper
from pipelines.paper import tables
from pipelines.paper.forced import pairs_apart
from pipelines.paper.parts import AGREES, DIFFERS, OWN_DATA, Column, NumberTable
from pipelines.paper.waves import cycle_s, turn_per_cycle_deg
from pipelines.plots.chart import Chart
from pipelines.simulate.responses import SimulatedInertance

FIGURES = {f"figure_{number}" for number in range(3, 13)} | {"sensitivity", "wheel"}


@pytest.fixture(scope="module")
def chapters(sample_result):
    return paper.paper_chapters(sample_result)


@pytest.fixture(scope="module")
def folder(chapters, sample_result, tmp_path_factory):
    folder = tmp_path_factory.mktemp("paper") / "paper"
    paper.write_paper(chapters, sample_result, folder)
    return folder


@pytest.fixture(scope="module")
def columns(chapters):
    """Columns of a table by the table's name."""
    named = {
        part.name: part for one in chapters for part in one.parts if isinstance(part, NumberTable)
    }
    return lambda name: {column.name: column.values for column in named[name].columns}


@pytest.fixture(scope="module")
def verdicts(chapters):
    """Verdicts by place, in the order of the statements there."""
    found = {}
    for statement in (one for chapter in chapters for one in chapter.statements):
        found.setdefault(statement.place, []).append(statement.verdict)
    return found


def test_every_figure_and_table_is_there(chapters):
    parts = [part for chapter in chapters for part in chapter.parts]
    assert {part.name for part in parts if isinstance(part, Chart)} == FIGURES
    names = {part.name for part in parts if isinstance(part, NumberTable)}
    assert {"table_3", "table_4", "table_5"} < names


def test_table_3_is_identified_from_recordings(columns):
    table = columns("table_3")
    np.testing.assert_allclose(table["identified_hz"], TABLE_3_FREQUENCIES_HZ, rtol=2e-3)
    np.testing.assert_allclose(table["identified_damping"], table["printed_damping"], rtol=0.05)


def test_table_4_comes_back_with_the_objective_of_the_paper(columns):
    table = columns("table_4")
    np.testing.assert_array_equal(table["printed"], [19.69, 6.56e5, 8.27e6, 2.52e7, 7.45])
    np.testing.assert_allclose(table["deviation_percent"], [-0.4, -12.8, -0.5, 0.0, -5.7], atol=0.1)


@pytest.mark.parametrize(
    ("name", "factor"),
    [
        ("mass_per_area_kg_m2", 1.002),
        ("radial_stiffness_n_m3", 0.995),
        ("circumferential_stiffness_n_m3", 4.0),
        ("bending_stiffness_n_m", 0.97),
        ("inflation_pressure_pa", 0.998),
    ],
)
def test_the_sum_of_squares_tells_other_values_from_the_printed_ones(name, factor):
    """Also where the standard deviation exceeds the value, as that of k_θ."""
    tuned = tables._tuned("paper").ring
    excess, explained = tables.excess_over_minimum(TABLE_4_RING, tuned)
    assert 0 < excess < explained < 0.5
    moved = replace(TABLE_4_RING, **{name: factor * getattr(TABLE_4_RING, name)})
    assert tables.sum_of_squares(moved) / tables.sum_of_squares(tuned) - 1 > explained


def test_the_steel_ring_has_the_frequencies_of_closed_forms(columns):
    steel = columns("steel_ring")
    known = [51.011, 144.280, 276.644, 447.393, 3292.72, 7362.75, 16.0, 12.0, 9.412]
    np.testing.assert_allclose(steel["closed_form_hz"], known, rtol=5e-5)
    eq_14 = [51.008, 144.272, 276.628, 447.365, 3292.72, 7363.06, 16.002, 12.005, 9.420]
    np.testing.assert_allclose(steel["equation_14_hz"], eq_14, rtol=5e-5)


def test_a_free_wheel_turns_freely_under_a_pressure_that_follows_only(columns):
    wheel = columns("wheel")
    cases = zip(wheel["pressure_load"], wheel["order"], strict=True)
    held = dict(zip(cases, wheel["together_hz"], strict=True))
    assert held.pop(("dead", 0)) > 10 and set(held.values()) == {0.0}
    np.testing.assert_allclose(wheel["free_hz"][2:], [44.36, 96.88], atol=0.01)


def test_nothing_simulated_is_called_measured(chapters):
    charts = [part for one in chapters for part in one.parts if isinstance(part, Chart)]
    for panel in (panel for chart in charts for panel in chart.plot.panels):
        named = [panel.title, panel.x.title, panel.y.title]
        named += [getattr(series, "name", "") for series in panel.series]
        assert not [text for text in named if "measured" in text]


def test_frequencies_of_table_4_with_the_first_mode_3_hz_off(columns):
    table = columns("table_4_frequencies")
    known_hz = [75.509, 100.742, 122.375, 145.435, 170.276, 196.645, 224.305]
    np.testing.assert_allclose(table["table_4_hz"], known_hz, atol=6e-4)
    assert np.abs(table["table_4_percent"][1:]).max() < 1.0
    assert table["equation_18_hz"][0] - TABLE_3_FREQUENCIES_HZ[0] == pytest.approx(-3.6, abs=0.1)
    assert np.abs(table["relative_percent"]).max() < 0.3


def test_table_5_gives_more_than_twice_the_damping_of_table_3(columns):
    ratios = columns("table_5_ratios")
    assert ratios["table_5"][0] == pytest.approx(0.091, abs=5e-4)
    assert ratios["table_5"][-1] == pytest.approx(0.044, abs=5e-4)
    refitted = [0.0399, 0.0295, 0.0255, 0.0229, 0.0209, 0.0193, 0.0180]
    np.testing.assert_allclose(ratios["refitted"], refitted, atol=6e-5)
    table = columns("table_5")
    np.testing.assert_allclose(table["refitted"], [800, 686, 0.0140], rtol=5e-3)


def test_peaks_of_figures_11_and_12(columns):
    """Known per unit of width; the sample tyre is 0.19 m wide."""
    at_rest, rolling = columns("figure_11_peaks"), columns("figure_12_peaks")
    known = [75.4, 103.8, 116.4, 148.6, 168.1, 222.6, 283.8]
    np.testing.assert_allclose(at_rest["table_5_hz"][:7], known, atol=0.06)
    heights = np.array([0.041, 0.253, 0.233, 0.305, 0.339, 0.489, 0.590])
    np.testing.assert_allclose(at_rest["table_5_height"][:7], heights / 0.19, rtol=0.015)
    known = [68.7, 93.7, 119.4, 144.1, 175.5, 200.5, 233.9, 258.2, 299.6]
    np.testing.assert_allclose(rolling["table_5_hz"][:9], known, atol=0.06)
    parted = [84.6, 93.4, 118.2, 130.0, 145.1, 158.5, 173.2, 180.1]
    np.testing.assert_allclose(rolling["refitted_hz"][1:9], parted, atol=0.06)


def test_damping_of_table_5_hides_the_pairs_and_that_of_table_3_does_not(columns):
    waves = columns("figure_12_waves")
    assert np.isnan(waves["table_5_regressive_hz"]).all()
    shown = np.flatnonzero(np.isfinite(waves["refitted_regressive_hz"])) + 1
    np.testing.assert_array_equal(shown, [1, 3, 4, 5, 7])


def test_minima_of_progressive_waves(columns):
    minima = columns("figure_6_minima")
    np.testing.assert_array_equal(minima["order"], [2, 3, 4])
    np.testing.assert_allclose(minima["speed_rad_s"], [569, 87, 36], atol=1.0)


def test_each_claim_gets_its_verdict(verdicts):
    every = [verdict for several in verdicts.values() for verdict in several]
    assert set(every) == {AGREES, DIFFERS, OWN_DATA}
    assert verdicts["Table 3"] == verdicts["Section 4, Fig. 4b"] == [OWN_DATA]
    assert verdicts["Section 4"] == [AGREES, AGREES]
    assert verdicts["Table 4"] == [DIFFERS, AGREES]
    assert verdicts["Section 5.3, Table 5"] == [DIFFERS]
    assert verdicts["Section 5.3, Fig. 11"] == [DIFFERS]
    assert verdicts["Section 5.3, Fig. 12"] == [DIFFERS, AGREES]
    waves = [one for place, one in verdicts.items() if re.match(r"Section 5\.[12]", place)]
    assert {verdict for several in waves for verdict in several} == {AGREES}


@pytest.mark.parametrize("frame", ["rotating", "absolute", "stationary"])
def test_after_a_cycle_the_pattern_is_the_first_one_turned(frame):
    pair = wave_pair(TABLE_4_RING, 3, 67.3)
    angles = np.linspace(0.0, 2.0 * np.pi, 200)
    first, second = pair.frequencies_rad_s(frame)
    turn = np.sign(second - first) * np.deg2rad(turn_per_cycle_deg(pair, frame))
    after = pair.radial(angles, cycle_s(pair), frame)[:, 0]
    np.testing.assert_allclose(after, 4.0 * np.cos(3 * (angles - turn)), atol=1e-9)


def test_a_pair_is_apart_where_both_waves_have_a_peak():
    waves = bifurcation(TABLE_4_RING, [1, 2, 3], 67.3)
    frequency_hz = np.arange(40.0, 160.0, 0.1)

    def comb(*peaks_hz):
        bumps = [np.exp(-((frequency_hz - peak) ** 2) / 2.0) for peak in peaks_hz]
        return SimulatedInertance(frequency_hz, np.sum(bumps, axis=0), "")

    assert pairs_apart(waves, comb(65.0, 93.0, 118.0)) == ()
    assert pairs_apart(waves, comb(64.0, 86.0, 93.0, 95.0, 118.0, 131.0)) == (1, 3)


def test_page_is_one_file_that_shows_everything(folder):
    page = (folder / "paper.html").read_text(encoding="utf-8")
    assert page.count('src="data:image/png;base64,') == len(FIGURES)
    assert not re.search(r'(?:src|href)="(?!data:|#)', page)
    for words in ("Table 3", "Table 4", "Table 5", "Fig. 10", "do not hold as printed"):
        assert words in page
    assert not re.search(r"\bnan\b", re.sub(r"base64,[^\"]+", "", page).lower())


def test_folder_holds_tables_and_figures(folder, chapters):
    names = {path.name for path in folder.iterdir()}
    assert {f"{name}.png" for name in FIGURES} | {"paper.html", "statements.csv"} < names
    with (folder / "table_4_frequencies.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [int(row["order"]) for row in rows] == TABLE_3_ORDERS.tolist()
    stored = [float(row["table_4_hz"]) for row in rows]
    np.testing.assert_array_equal(stored, natural_frequencies_hz(TABLE_4_RING, TABLE_3_ORDERS))
    with (folder / "table_3.csv").open(newline="", encoding="utf-8") as file:
        assert float(next(csv.DictReader(file))["identified_hz_std"]) > 0
    with (folder / "statements.csv").open(newline="", encoding="utf-8") as file:
        assert len(list(csv.DictReader(file))) == sum(len(one.statements) for one in chapters)


def test_cells_show_whole_numbers_words_and_unknown_values():
    column = Column("x", "x", [1, "word", 2.5, float("nan")])
    assert column.cells == ("1", "word", "2.500", "–")
    assert Column("x", "x", [78.728], [0.005]).cells == ("78.728 ± 0.005",)


@pytest.fixture
def processed(sample_result, monkeypatch):
    """Spare the processing of the sample campaign."""
    monkeypatch.setattr(paper, "process", lambda source, progress=None: sample_result)


@pytest.mark.usefixtures("processed")
def test_command_writes_and_names_the_page(ringmodal, chapters, tmp_path, monkeypatch):
    """Computing and drawing take their time and are tested by themselves."""
    monkeypatch.setattr(paper, "paper_chapters", lambda result: chapters)
    monkeypatch.setattr(paper, "png", lambda figure: b"\x89PNG")
    out = tmp_path / "paper"
    code, output, errors = ringmodal("paper", "--out", out)
    assert code == 0
    assert output.strip().splitlines()[-1] == f"Report: {out / 'paper.html'}"
    assert "Section 5.3, Table 5: differs." in output
    assert errors.startswith("Computing")
    again = ringmodal("paper", "--out", out, "--quiet")
    assert again[0] == 2 and "--force" in again[2]
    assert ringmodal("paper", "--out", out, "--force", "--quiet")[0] == 0
    assert [path.name for path in tmp_path.iterdir()] == ["paper"]


@pytest.mark.usefixtures("processed")
def test_a_folder_with_other_files_is_refused_before_anything_is_computed(tmp_path, monkeypatch):
    monkeypatch.setattr(paper, "paper_chapters", lambda result: pytest.fail("was computed"))
    (tmp_path / "letter.txt").write_text("dear", encoding="utf-8")
    with pytest.raises(InputError, match=r"letter\.txt"):
        paper.reproduce_paper(tmp_path, force=True)


def test_an_order_that_was_not_found_is_told(sample_result, monkeypatch):
    found = tables.ring_orders(sample_result.modal_model)
    monkeypatch.setattr(tables, "ring_orders", lambda model: found[1:])
    chapter = tables.identification(sample_result)
    assert chapter.statements[0].verdict == DIFFERS
    assert "Not all of the seven orders" in chapter.statements[0].found
    table = next(part for part in chapter.parts if isinstance(part, NumberTable))
    assert table.block.rows[0][2] == "–"
