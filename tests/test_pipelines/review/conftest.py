"""A result to review, identified once and in a narrow band."""

import pytest
from reviewing import copied, review

import ringmodal as rm
from ema.core.campaign import Processing
from pipelines.report.write import save
from pipelines.results.options import Options

BAND_HZ = (60.0, 160.0)


@pytest.fixture(scope="session")
def reviewed_once(short_campaign, process_once, tmp_path_factory):
    """The folder of a result with four modes; not to be changed."""
    folder = tmp_path_factory.mktemp("reviewed") / "result"
    result = process_once(short_campaign, Options(Processing(band_hz=BAND_HZ)))
    save(result, folder, report=False)
    return folder


@pytest.fixture(scope="session")
def reviewed_of_two(process_once, tmp_path_factory):
    """The folder of a result of two forces, at 0° and 22.5°; not to be changed."""
    place = tmp_path_factory.mktemp("two forces")
    kind = {"duration_s": 4.0, "snr_db": 40.0, "split_percent": 1.0, "force_deg": (0.0, 22.5)}
    campaign = rm.simulate_campaign(place / "campaign", at_once=True, **kind)
    result = process_once(campaign, Options(Processing(band_hz=BAND_HZ)))
    save(result, place / "result", report=False)
    return place / "result"


@pytest.fixture
def folder(reviewed_once, tmp_path):
    """A result of one's own."""
    return copied(reviewed_once, tmp_path)


@pytest.fixture
def page(folder):
    with review(folder) as page:
        yield page
