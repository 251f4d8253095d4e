"""Strict runs: a warning ends them before anything is computed or written."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

import ema
from ema.core.errors import InputError
from ema.core.finding import Check, Finding, Verdict
from pipelines.process.validate import refuse_warnings
from pipelines.results.store import MARKER

pytestmark = pytest.mark.usefixtures("modes_once")
WARNED = Finding(
    "config_1.uff", "A01", 0.0, Check.HUM, Verdict.WARNING, "50 Hz line 12 dB above its sides"
)


@pytest.fixture
def out(tmp_path):
    (tmp_path / "results").mkdir()
    return tmp_path / "results" / "result"


def test_a_strict_run_accepts_what_is_in_order():
    refuse_warnings([])
    refuse_warnings([replace(WARNED, verdict=Verdict.OK)] * 3)


@pytest.mark.parametrize("verdict", [Verdict.WARNING, Verdict.EXCLUDED])
def test_a_strict_run_names_the_first_warnings_and_counts_the_others(verdict):
    findings = [replace(WARNED, channel=f"A{k:02d}", verdict=verdict) for k in range(1, 8)]
    with pytest.raises(InputError) as refused:
        refuse_warnings([replace(WARNED, channel="fine", verdict=Verdict.OK), *findings])
    message = str(refused.value)
    assert message.startswith("--strict: hum, config_1.uff A01: 50 Hz line 12 dB")
    assert "A03" in message
    assert "A04" not in message
    assert "and 4 more" in message
    assert "fine" not in message


@given(st.lists(st.sampled_from([Verdict.OK, Verdict.WARNING, Verdict.EXCLUDED])))
def test_every_warning_is_named_or_counted(verdicts):
    findings = [replace(WARNED, verdict=verdict) for verdict in verdicts]
    doubtful = sum(verdict != Verdict.OK for verdict in verdicts)
    if not doubtful:
        refuse_warnings(findings)
        return
    with pytest.raises(InputError) as refused:
        refuse_warnings(findings)
    more = f"and {doubtful - 3} more" if doubtful > 3 else ""
    assert refused.value.found.count("hum") == min(doubtful, 3)
    assert more in refused.value.found
    assert ("more" in refused.value.found) == bool(more)


def test_strict_on_the_command_line(ringmodal, short_campaign, out):
    arguments = ("process", short_campaign, "--out", out, "--quiet", "--no-tune", "--no-report")
    code, output, errors = ringmodal(*arguments, "--averages", 1, "--strict")
    assert (code, output) == (2, "")
    assert errors.startswith("Error: --strict: a single average")
    assert len(errors.splitlines()) == 1
    assert not list(out.parent.iterdir())
    assert ringmodal(*arguments, "--averages", 1)[0] == 0
    before = (out / MARKER).read_bytes()
    assert ringmodal("tune", out, "--strict", "--no-report")[0] == 2
    assert (out / MARKER).read_bytes() == before


def test_strict_ends_before_anything_is_computed(ringmodal, short_campaign, out, monkeypatch):
    campaign = replace(ema.read_campaign(short_campaign), findings=(WARNED,))
    monkeypatch.setattr("ema.read_campaign", lambda _: campaign)
    code, _, errors = ringmodal("process", short_campaign, "--out", out, "--strict")
    assert code == 2
    assert "50 Hz line" in errors
    assert "Estimating" not in errors
    assert not list(out.parent.iterdir())


def test_good_recordings_pass_a_strict_run(ringmodal, short_campaign, out):
    code, _, _ = ringmodal("process", short_campaign, "--out", out, "--strict", "--no-report")
    assert code == 0
