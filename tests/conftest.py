"""What several test files share: the sample campaign, processed once, and a short one to break."""

from __future__ import annotations

import hashlib
import os
import pickle
import shutil
import sys
import tomllib
from functools import wraps
from pathlib import Path

import pytest
from browser import chromium
from hypothesis import HealthCheck, settings

import ema
from pipelines.cli import main as cli
from pipelines.process.run import process
from pipelines.report.write import save
from pipelines.simulate.campaign import simulate_campaign
from pipelines.storage.atomic import file_written_whole

# The same examples everywhere, and no verdict that depends on how busy a machine is.
settings.register_profile(
    "repeatable", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("repeatable")

SAMPLE = Path(__file__).parents[1] / "sample_data" / "tyre_225_55R17"


@pytest.fixture(scope="session", autouse=True)
def _no_wait_for_the_disk():
    """Tests end by kills, not by a loss of power: what the system has taken is stored."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fsync", lambda handle: None)
        yield


@pytest.fixture(scope="session")
def identified_once(tmp_path_factory):
    """`identify_modes`, which does not identify the same modes twice, not even in two workers."""
    base = tmp_path_factory.getbasetemp()
    known = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "modes"
    known.mkdir(exist_ok=True)
    identify = ema.identify_modes

    @wraps(identify)
    def identified(*arguments, **options):
        path = known / hashlib.sha256(pickle.dumps((arguments, options))).hexdigest()
        if not path.exists():
            with file_written_whole(path) as partial:
                partial.write_bytes(pickle.dumps(identify(*arguments, **options)))
        return pickle.loads(path.read_bytes())  # noqa: S301 - written by this run

    return identified


@pytest.fixture
def modes_once(identified_once, monkeypatch):
    """For tests of what comes before and after the identification, which takes most of the time."""
    monkeypatch.setattr("ema.identify_modes", identified_once)  # as `pipelines` calls it
    monkeypatch.setattr("ema.identify.identify_modes", identified_once)  # as `ringmodal` finds it


@pytest.fixture(scope="session")
def process_once(identified_once):
    """`process`, for results that tests share, whichever worker they are in."""

    def processed(*arguments):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("ema.identify_modes", identified_once)
            return process(*arguments)

    return processed


@pytest.fixture(scope="session")
def sample_campaign():
    return SAMPLE


@pytest.fixture(scope="session")
def truth():
    """Modes of the sample campaign by order."""
    content = tomllib.loads((SAMPLE / "truth.toml").read_text())
    return {mode["order"]: mode for mode in content["modes"]}


@pytest.fixture(scope="session")
def sample_result(process_once):
    return process_once(SAMPLE)


@pytest.fixture(scope="session")
def sample_folder(sample_result, tmp_path_factory):
    """The result folder of the sample campaign, report included; not to be changed."""
    folder = tmp_path_factory.mktemp("sample") / "result"
    save(sample_result, folder)
    return folder


@pytest.fixture(scope="session")
def browser():
    """A headless browser; tests that need it are skipped where there is none."""
    with chromium() as browser:
        yield browser


@pytest.fixture
def page(browser, sample_folder):
    """The sample report on a wide, light screen, to be looked at; quiet and off the network."""
    with browser.watched():
        browser.show()
        browser.keep_open(sample_folder / "report.html")
        yield browser


@pytest.fixture
def new_page(browser, sample_folder):
    """The same, just opened, to be worked with."""
    with browser.watched():
        browser.show()
        browser.open(sample_folder / "report.html")
        yield browser


@pytest.fixture(scope="session")
def short_campaign(tmp_path_factory):
    """A campaign of six runs of 4 s; not to be changed."""
    return simulate_campaign(tmp_path_factory.mktemp("short") / "campaign", duration_s=4.0)


@pytest.fixture(scope="session")
def short_result(short_campaign, process_once):
    return process_once(short_campaign)


@pytest.fixture
def campaign_copy(short_campaign, tmp_path):
    """A copy of the short campaign, to be broken."""
    return Path(shutil.copytree(short_campaign, tmp_path / "campaign"))


@pytest.fixture
def edit_manifest(campaign_copy):
    """Replace a text in the copy's manifest and return the campaign."""

    def edit(old, new):
        manifest = campaign_copy / "campaign.toml"
        text = manifest.read_text()
        assert old in text
        manifest.write_text(text.replace(old, new))
        return campaign_copy

    return edit


@pytest.fixture
def ringmodal(capsys, monkeypatch):
    """Run a command in this process; returns exit code, standard output and standard error."""

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["ringmodal", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        captured = capsys.readouterr()
        return ended.value.code or 0, captured.out, captured.err

    return run
