"""Findings about channels and runs: what was checked and with which verdict."""

from dataclasses import dataclass

OK = "ok"
WARNING = "warning"
EXCLUDED = "excluded"


@dataclass(frozen=True)
class Finding:
    """One line of ``quality.csv``.

    Parameters
    ----------
    run, channel : str
        What it is about; empty where it concerns the whole campaign or run.
    position_deg : float or None
        Where the channel sits.
    check : str
        Short name of the check, e.g. ``"reference"``, ``"coherence"``.
    verdict : str
        ``"ok"``, ``"warning"`` or ``"excluded"``.
    detail : str
        The number found and the rule, in words.
    """

    run: str
    channel: str
    position_deg: float | None
    check: str
    verdict: str
    detail: str
