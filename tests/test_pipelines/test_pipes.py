"""A pipe where a file is expected is refused at once: nobody waits for what may never come."""

import faulthandler
import os
import shutil
import sys
from pathlib import Path

import pytest
from library import SET, written

from pipelines.library.library import TyreLibrary
from pipelines.report.write import save

pytestmark = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="the system has no named pipes")
PARTS = ["provenance.json", "identification.json", "frf.parquet", "residues.parquet"]


def pipe(path):
    path.unlink(missing_ok=True)
    os.mkfifo(path)
    return path


@pytest.fixture
def refused(ringmodal):
    """A command ends by itself, with one message; one that waits would never end."""

    def refuse(*arguments):
        faulthandler.dump_traceback_later(60, exit=True, file=sys.__stderr__)
        try:
            code, output, errors = ringmodal(*arguments)
        finally:
            faulthandler.cancel_dump_traceback_later()
        assert code == 2, errors
        assert output == ""
        assert errors.splitlines()[-1].startswith("Error: ")

    return refuse


@pytest.fixture(scope="module")
def stored(short_result, tmp_path_factory):
    folder = tmp_path_factory.mktemp("stored") / "result"
    save(short_result, folder, report=False)
    return folder


def test_a_manifest(refused, campaign_copy, tmp_path):
    pipe(campaign_copy / "campaign.toml")
    refused("process", campaign_copy, "--out", tmp_path / "result")
    refused("process", campaign_copy / "campaign.toml", "--out", tmp_path / "result")
    refused("inspect", campaign_copy / "campaign.toml")


@pytest.mark.parametrize("name", ["run.uff", "run.csv", "run.h5", "run.parquet", "run.wav"])
def test_a_recording(refused, tmp_path, name):
    path = pipe(tmp_path / name)
    refused("process", path, "--out", tmp_path / "result")
    refused("inspect", path)


def test_a_parameter_set_and_a_property_file(refused, tmp_path):
    toml, tir = pipe(tmp_path / "tyre.toml"), pipe(tmp_path / "tyre.tir")
    whole = written(tmp_path / "set.toml")
    refused("simulate", "frequencies", "--tyre", toml)
    refused("tyre", "add", toml, "--library", tmp_path / "library")
    refused("tyre", "update-tir", tir, "--from", whole, "--yes")
    refused("tyre", "from-tir", tir, "--belt-width-m", 0.19)
    assert not (tmp_path / "library").exists()


@pytest.mark.parametrize("part", PARTS)
def test_a_part_of_a_result(refused, stored, tmp_path, part):
    copy = Path(shutil.copytree(stored, tmp_path / "result"))
    pipe(copy / part)
    refused("tune", copy, "--no-report")


def test_shapes_of_others(refused, stored, tmp_path):
    for name in ("shapes.csv", "shapes.uff"):
        refused("compare-shapes", stored, pipe(tmp_path / name))


def test_a_version_of_a_library(ringmodal, tmp_path):
    library = TyreLibrary(tmp_path / "library")
    for _ in range(2):
        version = library.add(written(tmp_path / "set.toml", SET), author="a")
    pipe(library.folder / version.tyre / "0001.toml")
    code, output, _ = ringmodal("tyre", "list", "--library", library.folder)
    assert code == 2
    assert version.tyre in output
