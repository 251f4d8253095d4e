"""What the command line says of an examination of the installation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict

from pipelines.console import print_json, say, screen
from pipelines.console_tables import Column, print_table
from pipelines.doctor_check import OK, PROBLEM, Check


def show_checks(checks: Sequence[Check], *, as_json: bool) -> None:
    """Print all checks, then what to do."""
    if as_json:
        print_json([asdict(check) for check in checks])
        return
    columns = [
        Column("check", [check.name for check in checks], is_text=True),
        Column("verdict", [check.verdict for check in checks], is_text=True),
        Column("found", [check.found for check in checks], is_text=True, folds=True),
    ]
    print_table(screen(), "", columns)
    for check in checks:
        if check.verdict != OK:
            say(f"{check.verdict.capitalize()}: {check.name}: {check.remedy}")
    problems = sum(check.verdict == PROBLEM for check in checks)
    say(f"Problems: {problems}." if problems else "No problem found: ringmodal can work here.")
