"""Whether this installation can work: libraries, optional parts, the machine, a small campaign."""

from __future__ import annotations

from pipelines.doctor_check import ADVICE, OK, PROBLEM, Check
from pipelines.doctor_libraries import (
    check_import_names,
    check_libraries,
    check_parts,
    check_python,
)

__all__ = ["ADVICE", "OK", "PROBLEM", "Check", "examine"]


def examine() -> list[Check]:
    """Look at everything, in the order in which one would mend it.

    Returns
    -------
    list of Check
        The machine and the small campaign are looked at only where no library is missing.
    """
    installed = [check_python(), *check_libraries(), *check_import_names()]
    checks = [*installed, *check_parts()]
    if any(check.verdict == PROBLEM for check in installed):
        remedy = "Mend what is above, then run `ringmodal doctor` again"
        return [*checks, Check("campaign", PROBLEM, "not tried", remedy)]
    try:
        return [*checks, *_machine()]
    except ImportError as error:
        remedy = f"pip install --force-reinstall {(error.name or 'ringmodal').partition('.')[0]}"
        return [*checks, Check("loading", PROBLEM, str(error), remedy)]


def _machine() -> list[Check]:
    from pipelines import doctor_machine as machine

    return [
        machine.check_linear_algebra(),
        machine.check_memory(),
        *machine.check_folders(),
        machine.check_terminal(),
        machine.check_campaign(),
    ]
