"""Malformed and unusual files, by name: each is read right or refused with a useful message."""

import re

import numpy as np
import pytest
from scenarios import Read
from scenarios_axes import SCENARIOS as AXES
from scenarios_binary import SCENARIOS as BINARY
from scenarios_campaign import SCENARIOS as CAMPAIGN
from scenarios_text import SCENARIOS as TEXT
from scenarios_uff import SCENARIOS as UFF
from scenarios_uff_headers import SCENARIOS as UFF_HEADERS

import ema
from ema.core.errors import InputError
from pipelines.prepare.inspection import inspect_files

SCENARIOS = (*UFF, *UFF_HEADERS, *TEXT, *CAMPAIGN, *BINARY, *AXES)


def test_scenarios_have_names_of_their_own():
    names = [each.name for each in SCENARIOS]
    assert len(set(names)) == len(names) >= 60


def _parameter(scenario):
    marks = [pytest.mark.xfail(reason=scenario.pending)] if scenario.pending else []
    return pytest.param(scenario, id=scenario.name, marks=marks)


@pytest.mark.parametrize("scenario", [_parameter(each) for each in SCENARIOS])
def test_scenario(tmp_path, scenario):
    source = scenario.build(tmp_path)
    expected = scenario.expected
    if isinstance(expected, Read):
        check_read(ema.read_campaign(source), expected)
    else:
        check_refused(lambda: ema.read_campaign(source), expected)


@pytest.mark.parametrize("scenario", SCENARIOS, ids=lambda each: each.name)
def test_inspection_names_what_it_cannot_read(tmp_path, scenario):
    found = inspect_files([scenario.build(tmp_path)])
    assert found.files or found.errors
    for error in found.errors:
        assert error.where and error.found and error.rule and error.remedy


def check_refused(act, expected):
    with pytest.raises(InputError) as caught:
        act()
    assert isinstance(caught.value, expected.error)
    assert expected.holds(caught.value) == [], str(caught.value)


def check_read(campaign, expected):
    assert len(campaign.runs) == expected.runs
    for run in campaign.runs:
        assert run.recording.names == expected.channels
        assert run.recording.sampling_rate_hz == expected.rate_hz
        for channel in run.recording.channels:
            first = expected.first.get(channel.name, ())
            np.testing.assert_allclose(channel.block(0, len(first)), first, rtol=1e-12)
    details = "\n".join(finding.detail for finding in campaign.findings)
    assert [each for each in expected.findings if not re.search(each, details)] == []
    if isinstance(expected.frf, int):
        frf = ema.estimate_frf(campaign)
        assert frf.n_positions == expected.frf
        assert np.isfinite(frf.values).all()
        assert frf.missing.any() == expected.missing
    else:
        check_refused(lambda: ema.estimate_frf(campaign), expected.frf)
