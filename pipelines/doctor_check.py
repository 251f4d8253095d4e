"""What an examination of the installation says about one thing."""

from __future__ import annotations

from dataclasses import dataclass

OK, ADVICE, PROBLEM = "ok", "advice", "problem"


@dataclass(frozen=True)
class Check:
    """One thing that was looked at.

    Parameters
    ----------
    name : str
        What.
    verdict : {"ok", "advice", "problem"}
    found : str
        What was found.
    remedy : str
        What to do; empty where all is well.
    """

    name: str
    verdict: str
    found: str
    remedy: str = ""
