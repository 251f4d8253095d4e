"""The examination of an installation: what is in order, what is missing, what is in the way."""

import json
import sys
from importlib.metadata import PackageNotFoundError

import pytest
from packaging.requirements import Requirement

from pipelines.cli import doctor
from pipelines.cli import doctor as doctor_libraries
from pipelines.cli import doctor as doctor_machine
from pipelines.cli.doctor import ADVICE, OK, PROBLEM, Check
from pipelines.results import provenance as versions

REQUIRED = [
    "numpy>=2.0",
    'h5py>=3.9; extra == "hdf5"',
    'npTDMS>=1.7; extra == "tdms"',
    'colours; sys_platform == "no such system"',
]


@pytest.fixture
def installed(monkeypatch):
    """Set what the package requires and which versions are there."""

    def set_versions(**there):
        monkeypatch.setattr(doctor_libraries, "requires", lambda name: REQUIRED)
        monkeypatch.setattr(
            doctor_libraries, "installed_version", lambda name: there.get(name, versions.UNKNOWN)
        )

    return set_versions


@pytest.fixture
def healthy(monkeypatch):
    """An examination that takes no time and finds what it is told."""

    def finds(*checks):
        monkeypatch.setattr("pipelines.cli.start.examine", lambda: list(checks))

    return finds


def test_a_library_that_is_new_enough(installed):
    installed(numpy="2.10.1")
    assert doctor_libraries.check_libraries() == [Check("numpy", OK, "2.10.1")]


@pytest.mark.parametrize(
    ("there", "found"),
    [({"numpy": "1.26.4"}, "1.26.4, and >=2.0 is needed"), ({}, "not installed")],
)
def test_a_library_that_is_old_or_missing(installed, there, found):
    installed(**there)
    expected = Check("numpy", PROBLEM, found, 'pip install "numpy>=2.0"')
    assert doctor_libraries.check_libraries() == [expected]


def test_parts_that_are_missing_are_advice_with_the_command_that_adds_them(installed):
    installed(numpy="2.0", h5py="3.12")
    hdf5, tdms = doctor_libraries.check_parts()
    assert hdf5 == Check("part hdf5", OK, "h5py 3.12")
    assert (tdms.verdict, tdms.found) == (ADVICE, "npTDMS not installed")
    assert tdms.remedy.endswith('pip install "ringmodal[tdms]"')


def test_an_uninstalled_package_is_a_problem(monkeypatch):
    def none(name):
        raise PackageNotFoundError(name)

    monkeypatch.setattr(doctor_libraries, "metadata", none)
    check = doctor_libraries.check_python()
    assert (check.verdict, "pip install" in check.remedy) == (PROBLEM, True)


def test_an_old_python_is_a_problem(monkeypatch):
    monkeypatch.setattr(doctor_libraries.platform, "python_version", lambda: "3.10.4")
    monkeypatch.setattr(doctor_libraries, "metadata", lambda name: {"Requires-Python": ">=3.11"})
    check = doctor_libraries.check_python()
    assert (check.verdict, check.found, check.remedy) == (
        PROBLEM,
        "3.10.4",
        "Install Python >=3.11",
    )


def test_names_that_are_nobody_elses(monkeypatch, tmp_path):
    (tmp_path / "model").mkdir()  # a folder without __init__.py takes no name away
    monkeypatch.setattr(sys, "path", [*sys.path, str(tmp_path)])
    (check,) = doctor_libraries.check_import_names()
    assert check.verdict == OK


@pytest.mark.parametrize("other", ["model/__init__.py", "model.py"])
def test_another_package_of_the_same_name_is_named(monkeypatch, tmp_path, other):
    (tmp_path / other).parent.mkdir(exist_ok=True)
    (tmp_path / other).write_text("")
    monkeypatch.setattr(sys, "path", [*sys.path, str(tmp_path)])
    (check,) = doctor_libraries.check_import_names()
    assert (check.name, check.verdict) == ("name model", ADVICE)  # found behind our own
    assert str(tmp_path / other.removesuffix("/__init__.py")) in check.found
    monkeypatch.setattr(doctor_libraries, "_imported_from", lambda name: tmp_path)
    assert doctor_libraries.check_import_names()[0].verdict == PROBLEM


def test_folders_are_written_to(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    temporary, current = doctor_machine.check_folders()
    assert current.verdict in (OK, ADVICE)
    assert str(tmp_path) in current.found
    assert list(tmp_path.iterdir()) == []
    monkeypatch.setattr(doctor_machine.tempfile, "gettempdir", lambda: str(tmp_path / "nowhere"))
    assert doctor_machine.check_folders()[0].verdict == PROBLEM
    assert temporary.name == "temporary folder"


def test_little_memory_is_advice(monkeypatch):
    for free_bytes, verdict in ((8e9, OK), (2e8, ADVICE), (None, OK)):
        monkeypatch.setattr(doctor_machine, "_free_memory_bytes", lambda free=free_bytes: free)
        assert doctor_machine.check_memory().verdict == verdict


def test_linear_algebra_is_named():
    check = doctor_machine.check_linear_algebra()
    assert (check.verdict, "cores" in check.found) == (OK, True)


def test_a_small_campaign_comes_back_as_its_modes():
    check = doctor_machine.check_campaign()
    assert check.verdict == OK
    assert check.found.startswith("8 modes")


def test_modes_that_are_off_are_a_problem(monkeypatch):
    monkeypatch.setattr(doctor_machine, "_PROOF_LIMIT", 1e-9)
    assert doctor_machine.check_campaign().verdict == PROBLEM


def test_a_missing_library_ends_the_examination_before_anything_is_loaded(installed):
    installed()
    checks = doctor.examine()
    assert checks[-1] == Check(
        "campaign",
        PROBLEM,
        "not tried",
        "Fix the problems above, then run `ringmodal doctor` again",
    )


def test_a_library_that_cannot_be_loaded_is_named(monkeypatch, installed):
    installed(numpy="2.1")

    def fail():
        raise ImportError("DLL load failed", name="numpy._core")

    monkeypatch.setattr(doctor, "_machine", fail)
    check = doctor.examine()[-1]
    assert (check.verdict, check.found) == (PROBLEM, "DLL load failed")
    assert check.remedy == "pip install --force-reinstall numpy"


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
    assert doctor_libraries._requirements("") == [Requirement("numpy>=2.0")]
