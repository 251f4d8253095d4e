"""A batch: every campaign by itself, none twice, and tables over all of them."""

import json
import shutil

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from fleets import BROKEN, GOOD, NAMES, QUICK, edit, write_campaign, write_fleet

from ema.core.errors import InputError
from pipelines.batch import campaigns as batch_task
from pipelines.batch import run as batch
from pipelines.batch.run import run_batch
from pipelines.batch.state import choices, take_fingerprint
from pipelines.batch.workers import in_this_process
from pipelines.process.run import process
from pipelines.results.options import Options
from pipelines.results.parameter_set import read_parameter_set
from pipelines.results.tables import MODES

TABLES = ("modes.parquet", "parameters.parquet")


@pytest.fixture(scope="module", autouse=True)
def no_workers():
    """Keep the work where tests can watch it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(batch, "on_this_machine", lambda tasks, work, _: in_this_process(tasks, work))
        yield


@pytest.fixture(scope="module")
def fleet(short_campaign, tmp_path_factory):
    """Two campaigns to process and six broken ones; not to be changed."""
    return write_fleet(short_campaign, tmp_path_factory.mktemp("fleet") / "root")


@pytest.fixture(scope="module")
def first(fleet, tmp_path_factory):
    """What a first run gives; not to be changed."""
    out = tmp_path_factory.mktemp("batch") / "out"
    return run_batch(fleet, out, QUICK, jobs=1)


@pytest.fixture
def again(fleet, first, tmp_path):
    """A copy of fleet and results, to be changed; runs the batch on it."""
    root = shutil.copytree(fleet, tmp_path / "root")
    out = shutil.copytree(first.folder.path, tmp_path / "out")

    def run(options=QUICK, **choices):
        return run_batch(root, out, options, jobs=1, **choices)

    run.root, run.out = root, out
    return run


def test_every_campaign_has_a_row_in_the_order_of_the_names(first):
    assert tuple(record.campaign for record in first.records) == NAMES
    assert first.fresh == set(NAMES)
    assert [record.campaign for record in first.records if record.is_done] == list(GOOD)


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_campaign_is_a_row_with_its_message(first, name):
    record = next(each for each in first.records if each.campaign == name)
    assert not record.is_done
    assert record.traceback == ""
    for words in BROKEN[name]:
        assert words in record.message
    assert not first.folder.result(name).exists()


@pytest.mark.parametrize("name", GOOD)
def test_results_are_those_of_a_single_run(fleet, first, name):
    single = process(fleet / name, QUICK)
    record = next(each for each in first.records if each.campaign == name)
    frequency_hz = [row[MODES.index("frequency_hz")] for row in record.modes]
    assert frequency_hz == [mode.frequency_hz for mode in single.modal_model.modes]
    table = pd.read_csv(first.folder.result(name) / "modes.csv")
    np.testing.assert_array_equal(table["frequency_hz"], frequency_hz)
    assert not (first.folder.result(name) / "report.html").exists()


def test_the_fingerprint_is_that_of_the_files(fleet, first):
    for record in first.records:
        expected = take_fingerprint(fleet / record.campaign, choices(QUICK))
        assert record.fingerprint == expected


def test_tables_hold_all_campaigns_for_other_programs(first):
    modes = pd.read_parquet(first.folder.modes)
    assert list(modes.columns) == ["campaign", "designation", "inflation_pressure_pa", *MODES]
    assert list(modes["campaign"].unique()) == list(GOOD)
    assert set(modes["designation"]) == {"225/55R17"}
    assert set(modes["inflation_pressure_pa"]) == {220000.0}
    results = [pd.read_csv(first.folder.result(name) / "modes.csv") for name in GOOD]
    for column in ("mode", "order", "frequency_hz", "damping_ratio_std", "status"):
        expected = pd.concat(results, ignore_index=True)[column]
        pd.testing.assert_series_equal(modes[column], expected, check_dtype=False, rtol=0)
    campaigns = pd.read_parquet(first.folder.campaigns)
    assert tuple(campaigns["campaign"]) == NAMES
    assert (campaigns["status"] == "failed").sum() == len(BROKEN)
    assert campaigns["n_modes"].sum() == len(modes)
    assert len(pd.read_parquet(first.folder.parameters)) == 0  # nothing was tuned


def test_parameters_are_those_of_the_parameter_sets(short_campaign, tmp_path):
    write_campaign(short_campaign, tmp_path / "root" / "tyre")
    found = run_batch(tmp_path / "root", tmp_path / "out", Options(max_order=20), jobs=1)
    table = pd.read_parquet(found.folder.parameters).set_index("parameter")
    written = read_parameter_set(found.folder.result("tyre") / "tyre.toml")
    expected = {**written.ring, **written.damping}
    assert list(table.index) == list(expected)
    assert {"given", "identified"} <= set(table["how"])
    for name, parameter in expected.items():
        assert table.loc[name, "value"] == parameter.value
        assert table.loc[name, "how"] == parameter.how
        std = table.loc[name, "std"]
        assert std == parameter.std or (np.isnan(std) and parameter.std is None)


def test_a_second_run_does_nothing(again, monkeypatch):
    before = {path: path.stat().st_mtime_ns for path in again.out.rglob("*") if path.is_file()}
    monkeypatch.setattr(batch_task, "process", None)
    found = again()
    assert found.fresh == frozenset()
    assert tuple(record.campaign for record in found.records) == NAMES
    after = {path: path.stat().st_mtime_ns for path in again.out.rglob("*") if path.is_file()}
    assert after == before


def test_only_what_changed_is_done_again(again):
    edit(again.root / GOOD[0], "position_deg = 0.0", "position_deg = 5.0")
    assert again().fresh == {GOOD[0]}
    assert again().fresh == frozenset()


def test_a_mended_campaign_is_done_and_a_broken_one_loses_its_row(again):
    shutil.copy(again.root / GOOD[0] / "config_1.uff", again.root / "recording missing")
    (again.root / GOOD[1] / "config_1.uff").unlink()
    found = again()
    assert found.fresh == {"recording missing", GOOD[1]}
    modes = pq.read_table(found.folder.modes).column("campaign").unique().to_pylist()
    assert modes == [GOOD[0], "recording missing"]


def test_a_touched_file_is_looked_at_and_remembered(again, monkeypatch):
    monkeypatch.setattr(batch_task, "process", None)
    (again.root / GOOD[0] / "config_1.uff").touch()
    record = again.out / "records" / GOOD[0] / "record.json"
    before = json.loads(record.read_text())
    assert again().fresh == frozenset()
    after = json.loads(record.read_text())
    assert after["fingerprint"]["digest"] == before["fingerprint"]["digest"]
    assert after["fingerprint"]["files"] != before["fingerprint"]["files"]


def test_other_options_do_all_again(again, monkeypatch):
    monkeypatch.setattr(batch_task, "process", _refuse)
    assert again(Options(max_order=22, tune=False)).fresh == set(NAMES)


def test_failed_campaigns_are_tried_again_when_asked_to(again):
    found = again(retry_failed=True)
    assert found.fresh == set(BROKEN)
    assert found.count(done=True, fresh=False) == len(GOOD)
    assert found.count(done=False, fresh=True) == len(BROKEN)


@pytest.mark.parametrize("damage", ["", "{", "[]", '{"schema": 1}', '{"schema": 99}'])
def test_without_a_whole_record_a_campaign_is_done_again(again, monkeypatch, damage):
    monkeypatch.setattr(batch_task, "process", _refuse)
    (again.out / "records" / GOOD[0] / "record.json").write_text(damage)
    assert again().fresh == {GOOD[0]}


def test_a_result_that_is_gone_and_a_report_that_is_wanted_are_made(again):
    shutil.rmtree(again.out / "results" / GOOD[0])
    assert again().fresh == {GOOD[0]}
    shutil.rmtree(again.root / GOOD[1])
    found = again(reports=True)
    assert found.fresh == {GOOD[0]}
    assert found.folder.result(GOOD[0]).joinpath("report.html").is_file()
    assert "results/2025/tyre_1/report.html" in found.folder.summary.read_text()


@pytest.mark.parametrize("name", [*TABLES, "campaigns.parquet", "summary.html"])
def test_missing_tables_are_written_again_from_the_records(again, name):
    before = (again.out / name).read_bytes()
    (again.out / name).unlink()
    assert again().fresh == frozenset()
    assert (again.out / name).read_bytes() == before


def test_a_campaign_that_is_gone_leaves_the_tables_but_not_its_result(again):
    shutil.rmtree(again.root / GOOD[0])
    found = again()
    assert found.fresh == frozenset()
    assert found.folder.result(GOOD[0]).is_dir()
    campaigns = pq.read_table(found.folder.campaigns).column("campaign").to_pylist()
    assert campaigns == [name for name in NAMES if name != GOOD[0]]


def test_a_fault_of_the_program_is_a_row_that_says_where(again, monkeypatch):
    monkeypatch.setattr(batch_task, "process", _fail)
    edit(again.root / GOOD[0], "position_deg = 0.0", "position_deg = 5.0")
    record = again().records[0]
    assert record.campaign == GOOD[0]
    assert record.message.startswith("Internal error: RuntimeError: a fault")
    assert "in _fail" in record.traceback
    assert "report" in (again.out / "summary.html").read_text()


def test_too_little_memory_is_a_row(again, monkeypatch):
    monkeypatch.setattr(batch_task, "process", _exhaust)
    edit(again.root / GOOD[0], "position_deg = 0.0", "position_deg = 5.0")
    record = again().records[0]
    assert record.message.startswith("not enough memory")
    assert record.traceback == ""


def test_a_file_that_changes_while_it_is_read_gives_no_result(again, monkeypatch):
    def late(campaign, options):
        edit(campaign, "position_deg = 5.0", "position_deg = 55.0")

    monkeypatch.setattr(batch_task, "process", late)
    edit(again.root / GOOD[0], "position_deg = 0.0", "position_deg = 5.0")
    assert "changed while" in again().records[0].message


def test_a_place_with_other_files_is_refused(fleet, tmp_path):
    (tmp_path / "holiday.jpg").touch()
    with pytest.raises(InputError, match="other files"):
        run_batch(fleet, tmp_path, QUICK, jobs=1)
    with pytest.raises(InputError, match=r"batch writes"):
        run_batch(fleet, tmp_path / "holiday.jpg" / "out", QUICK, jobs=1)


def test_workers_are_chosen_once(fleet, tmp_path):
    with pytest.raises(InputError, match="--jobs 2 and --scheduler"):
        run_batch(fleet, tmp_path / "out", QUICK, jobs=2, scheduler="tcp://nowhere:8786")


def test_what_ended_early_goes_on_where_it_stopped(fleet, tmp_path, monkeypatch):
    monkeypatch.setattr(batch_task, "process", _refuse)

    def interrupt(record, done, total):
        if done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_batch(fleet, tmp_path / "out", QUICK, jobs=1, finished=interrupt)
    found = run_batch(fleet, tmp_path / "out", QUICK, jobs=1)
    assert len(found.fresh) == len(NAMES) - 3
    assert found.folder.is_complete()


def test_progress_counts_what_is_to_do(again):
    told = []
    again(retry_failed=True, finished=lambda *values: told.append(values))
    assert [done for _, done, _ in told] == list(range(1, len(BROKEN) + 1))
    assert {total for *_, total in told} == {len(BROKEN)}


def _refuse(campaign, options):
    raise InputError(campaign.name, "a test", "nothing is processed here", "Go on")


def _fail(campaign, options):
    raise RuntimeError("a fault")


def _exhaust(campaign, options):
    raise MemoryError
