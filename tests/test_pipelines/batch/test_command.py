"""``ringmodal batch``: what it prints, its exit codes, its summary page."""

import json
import re

import pytest
from fleets import BROKEN, write_fleet

from pipelines.batch import campaigns as batch_task
from pipelines.batch import run as batch
from pipelines.batch.campaigns import CampaignFolder
from pipelines.batch.run import frequencies_chart, write_summary
from pipelines.batch.state import (
    DONE,
    FAILED,
    BatchFolder,
    Fingerprint,
    Record,
    read_record,
    write_record,
)
from pipelines.batch.workers import in_this_process

ONCE = ("--jobs", 1, "--no-tune", "--max-order", 20)
MODE = (1, 2, "", 100.3, 0.04, 0.03, 0.0003, 0.99, 0.7, 0.99, "ok", "one member seen", 0.001, 1e-5)


@pytest.fixture(autouse=True)
def no_workers(monkeypatch):
    """Keep the work where tests can watch it."""
    monkeypatch.setattr(
        batch, "on_this_machine", lambda tasks, work, _: in_this_process(tasks, work)
    )


@pytest.fixture
def root(short_campaign, tmp_path):
    return write_fleet(short_campaign, tmp_path / "root")


@pytest.fixture
def broken(root, monkeypatch):
    """A fleet of which nothing can be processed."""

    def read_what_is_gone(campaign, options):
        return (campaign / "gone").read_bytes()

    monkeypatch.setattr(batch_task, "process", read_what_is_gone)
    return root


def record(name, tyre="225/55R17", modes=(MODE,), **more):
    return Record(name, DONE, Fingerprint("", ()), designation=tyre, modes=modes, **more)


def failed(name, message):
    return Record(name, FAILED, Fingerprint("", ()), message=message)


def page_of(records, tmp_path):
    folder = BatchFolder(tmp_path)
    campaigns = [CampaignFolder(each.campaign, each.campaign, tmp_path) for each in records]
    write_summary(records, campaigns, folder)
    return folder.summary.read_text(encoding="utf-8")


def test_it_says_what_became_of_each_campaign_and_ends_with_1(ringmodal, root, tmp_path):
    out = tmp_path / "out"
    code, output, errors = ringmodal("batch", root, "--out", out, *ONCE)
    assert code == 1
    page = out / "summary.html"
    assert output == f"2 done, 6 failed (see {page}), 0 already done\n"
    assert re.search(r"^\[1/8, .+ left\] 2025/tyre_1: 9 modes, .* s$", errors, re.MULTILINE)
    assert re.search(r"^\[8/8\] recording truncated: failed\. config_1", errors, re.MULTILINE)
    assert ringmodal("batch", root, "--out", out, *ONCE, "--quiet") == (1, "", "")
    code, output, _ = ringmodal("batch", root, "--out", out, *ONCE)
    assert code == 1
    assert output == (
        f"Nothing to do: 0 done, 0 failed (see {page}), 2 already done, "
        "6 failed before (use --retry-failed to retry them)\n"
    )


def test_json_prints_the_rows_and_quiet_nothing_else(ringmodal, broken, tmp_path):
    code, output, errors = ringmodal(
        *("batch", broken, "--out", tmp_path / "out", *ONCE, "--json", "--quiet")
    )
    assert (code, errors) == (1, "")
    content = json.loads(output)
    assert (content["done"], content["failed"], content["already_done"]) == (0, 8, 0)
    rows = {row["campaign"]: row for row in content["campaigns"]}
    assert set(BROKEN) < set(rows)
    assert {row["status"] for row in rows.values()} == {"failed"}
    assert "gone: No such file" in rows["2025/tyre_1"]["message"]


def test_strict_ends_with_1_too(ringmodal, broken, tmp_path):
    code, output, _ = ringmodal("batch", broken, "--out", tmp_path / "out", *ONCE, "--strict")
    assert code == 1
    assert "0 done, 8 failed" in output


def test_bad_use_is_one_message(ringmodal, tmp_path):
    code, output, errors = ringmodal(
        "batch", tmp_path / "nowhere", "--out", tmp_path / "out", "--quiet"
    )
    assert (code, output) == (2, "")
    assert errors.startswith("Error: ")
    assert not (tmp_path / "out").exists()


def test_help_gives_the_options_of_the_processing_too(ringmodal, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    code, output, _ = ringmodal("batch", "--help")
    assert code == 0
    for option in (
        "--scheduler",
        "--retry-failed",
        "--reports",
        "--band-hz",
        "--given",
        "--strict",
    ):
        assert option in output


def test_records_come_back_as_they_were(tmp_path):
    whole = record("a", n_warnings=2, parameters=(("radius", 0.33, None, "given"),))
    write_record(whole, tmp_path / "record.json")
    assert read_record(tmp_path / "record.json") == whole


def test_the_page_links_results_and_tells_failures(tmp_path):
    (tmp_path / "results" / "a").mkdir(parents=True)
    (tmp_path / "results" / "a" / "report.html").touch()
    records = [record("a"), record("b & c"), failed("d<e>", "run_1: silent; no force. Look.")]
    page = page_of(records, tmp_path)
    assert '<a href="results/a/report.html">a</a>' in page
    assert '<a href="results/b%20%26%20c">b &amp; c</a>' in page
    assert "d&lt;e&gt;: run_1: silent; no force. Look." in page
    assert "1 of 3 have no result" in page
    assert 'src="http' not in page


def test_the_page_of_nothing_but_failures_has_no_figure(tmp_path):
    page = page_of([failed("a", "no")], tmp_path)
    assert "<img" not in page
    assert "Every campaign" not in page


def test_the_page_tells_where_the_extremes_of_an_order_are(tmp_path):
    low, high = ((*MODE[:3], hz, *MODE[4:]) for hz in (90.0, 110.0))
    page = page_of([record("a", modes=(low,)), record("b", modes=(high,))], tmp_path)
    cells = re.findall(r"<td[^>]*>\s*(.*?)</td>", page)
    assert cells[:8] == ["225/55R17", "2", "2", "100.00", "90.000", "a", "110.00", "b"]


def test_the_figure_shows_every_mode_with_an_order_once():
    without = (1, None, *MODE[2:])
    tyres = [f"tyre {k}" for k in range(9)]
    chart = frequencies_chart([record(t, t, (MODE, without)) for t in tyres] + [failed("x", "no")])
    (ax,) = chart.draw().axes
    assert sum(line.get_xdata().size for line in ax.lines) == len(tyres)
    assert {y for line in ax.lines for y in line.get_ydata()} == {100.3}
    x = sorted(float(line.get_xdata()[0]) for line in ax.lines)
    assert 1.6 < x[0] < x[-1] < 2.4
    labels = [text.get_text() for text in ax.get_legend().get_texts()]
    assert labels == [*tyres[:6], "others"]
