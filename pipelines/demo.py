"""The sample campaign, processed for a first look."""

from __future__ import annotations

from pathlib import Path

from pipelines.process import process
from pipelines.result import Result
from pipelines.store import save

SAMPLE = Path("sample_data") / "tyre_225_55R17"


def run_demo(out: Path) -> tuple[Result, Path]:
    """Process the sample campaign into ``out/result``.

    The campaign comes from the project's folder; where that is not at hand it is written to
    ``out/campaign`` first.

    Parameters
    ----------
    out : Path
        Folder for the demonstration; an earlier demonstration is replaced.
    """
    result = process(sample_campaign(out / "campaign"))
    folder = out / "result"
    save(result, folder, force=True)
    return result, folder


def sample_campaign(folder: Path) -> Path:
    """The sample campaign of the project's folder; simulated into `folder` where not at hand."""
    for root in (Path.cwd(), Path(__file__).resolve().parents[1]):
        if (root / SAMPLE / "campaign.toml").is_file():
            return root / SAMPLE
    if not (folder / "campaign.toml").is_file():
        from pipelines.simulate_campaign import simulate_campaign

        simulate_campaign(folder)
    return folder
