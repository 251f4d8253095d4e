"""The examination of an installation: what is in order, what is missing."""

import json
import os
from importlib.metadata import PackageNotFoundError

import pytest
from packaging.requirements import Requirement

from pipelines.cli import doctor
from pipelines.cli.doctor import ADVICE, OK, PROBLEM, Check

REQUIRED = [
    "numpy>=2.0",
    'h5py>=3.9; extra == "hdf5"',
    'npTDMS>=1.7; extra == "tdms"',
    'weasyprint>=1.0; extra == "pdf"',
    'distributed>=1.0; extra == "cluster"',
    'colours; sys_platform == "no such system"',
]


@pytest.fixture
def installed(monkeypatch):
    """Set which versions of the required libraries are there."""

    def set_versions(**there):
        def version(name):
            if name not in there:
                raise PackageNotFoundError(name)
            return there[name]

        monkeypatch.setattr(doctor, "requires", lambda name: REQUIRED)
        monkeypatch.setattr(doctor, "version", version)

    return set_versions


@pytest.fixture
def healthy(monkeypatch):
    """An examination that takes no time and returns given checks."""

    def finds(*checks):
        monkeypatch.setattr(doctor, "examine", lambda: list(checks))

    return finds


def test_a_library_that_is_new_enough(installed, monkeypatch):
    installed(numpy="2.10.1")
    monkeypatch.setattr(doctor, "check_campaign", lambda: Check("campaign", OK, ""))
    monkeypatch.setattr(doctor, "check_linear_algebra", lambda: Check("BLAS", OK, ""))
    assert doctor.examine()[1] == Check("numpy", OK, "2.10.1")


@pytest.mark.parametrize(
    ("there", "found"), [({"numpy": "1.26.4"}, "1.26.4, >=2.0 required"), ({}, "not installed")]
)
def test_a_library_that_is_old_or_missing(installed, there, found):
    installed(**there)
    expected = Check("numpy", PROBLEM, found, 'pip install "numpy>=2.0"')
    assert doctor.examine()[1] == expected


def test_parts_that_are_missing_are_advice_with_the_command_that_adds_them(installed):
    installed(numpy="2.0", h5py="3.12")
    hdf5, tdms = map(doctor.check_part, ("hdf5", "tdms"))
    assert hdf5 == Check("part hdf5", OK, "h5py 3.12")
    assert (tdms.verdict, tdms.found) == (ADVICE, "npTDMS not installed")
    assert tdms.remedy.endswith('pip install "npTDMS>=1.7"')


def test_an_uninstalled_package_is_a_problem(monkeypatch):
    def none(name):
        raise PackageNotFoundError(name)

    monkeypatch.setattr(doctor, "requires", none)
    check = doctor.examine()[1]
    assert (check.verdict, "pip install" in check.remedy) == (PROBLEM, True)


def test_folders_are_written_to(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    _, temporary, current, _ = doctor.check_machine()
    assert current.verdict in (OK, ADVICE)
    assert str(tmp_path) in current.found
    assert list(tmp_path.iterdir()) == []
    monkeypatch.setattr(doctor.tempfile, "gettempdir", lambda: str(tmp_path / "nowhere"))
    assert doctor.check_machine()[1].verdict == PROBLEM
    assert temporary.name == "temporary folder"


def test_little_memory_is_advice(monkeypatch):
    for free_bytes, verdict in ((8e9, OK), (2e8, ADVICE), (None, OK)):
        monkeypatch.setattr(doctor, "_free_memory_bytes", lambda free=free_bytes: free)
        assert doctor.check_machine()[0].verdict == verdict


def test_linear_algebra_is_named():
    check = doctor.check_linear_algebra()
    assert (check.verdict, "cores" in check.found) == (OK, True)


def test_a_small_campaign_comes_back_as_its_modes():
    check = doctor.check_campaign()
    assert check.verdict == OK
    assert check.found.startswith("9 modes")


@pytest.mark.parametrize("errors", [[], [1e-4] * 3, [1e-4] * 7 + [0.01]])
def test_modes_that_are_off_or_missing_are_a_problem(monkeypatch, errors):
    monkeypatch.setattr(doctor, "campaign_errors", lambda: errors)
    assert doctor.check_campaign().verdict == PROBLEM


def test_a_missing_library_ends_the_examination_before_the_campaign(installed):
    installed()
    last = doctor.examine()[-1]
    assert (last.name, last.verdict, last.found) == ("campaign", PROBLEM, "not tried")


def test_a_library_that_cannot_be_loaded_is_named(monkeypatch, tmp_path):
    (tmp_path / "numpy.py").write_text('raise ImportError("DLL load failed")')
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}{os.pathsep}{os.environ.get('PYTHONPATH', '')}")
    check = doctor.examine()[-1]
    assert (check.name, check.verdict) == ("campaign", PROBLEM)
    assert "DLL load failed" in check.found


@pytest.mark.parametrize(("verdict", "code"), [(OK, 0), (ADVICE, 0), (PROBLEM, 1)])
def test_only_problems_end_with_code_1(ringmodal, healthy, verdict, code):
    healthy(Check("Python", OK, "3.12"), Check("memory", verdict, "0.1 GB", "Close programs"))
    ended, output, _ = ringmodal("doctor")
    assert ended == code
    assert ("Close programs" in output) == (verdict != OK)
    assert ("No problem found" in output) == (verdict != PROBLEM)


def test_json_has_every_check(ringmodal, healthy):
    healthy(Check("Python", OK, "3.12"), Check("memory", ADVICE, "0.1 GB", "Close programs"))
    code, output, errors = ringmodal("doctor", "--json")
    assert (code, errors) == (0, "")
    assert json.loads(output)[1] == {
        "name": "memory",
        "verdict": "advice",
        "found": "0.1 GB",
        "remedy": "Close programs",
    }


def test_requirements_for_other_systems_are_left_out(installed):
    installed(numpy="2.0")
    assert doctor.requirements("") == [Requirement("numpy>=2.0")]
