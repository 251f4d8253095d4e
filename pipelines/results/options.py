"""Options of a run, with the same names in Python and on the command line."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from ema.core.campaign import Campaign, Processing
from ema.core.errors import InputError
from ema.core.settings import CheckSettings, IdentificationSettings

#: Widest default band of a tyre.
TYRE_BAND_HZ = (20.0, 300.0)


@dataclass(frozen=True)
class Options:
    """Options of a run; None leaves the value of the manifest or a default in force.

    Parameters
    ----------
    processing : Processing
        Averages, block length, window, overlap and band; what is set here overrides the manifest.
    estimator : {"H1", "H2", "Hv"}
        FRF estimator.
    max_order : int
        Highest model order of the stability diagram.
    pinned_hz : tuple of float
        Frequencies of the modes, instead of the automatic selection; empty for automatic.
    excluded_hz : tuple of float
        Frequencies of poles that are not modes.
    method : {"lsce", "plscf"}
        Pole estimator; the other one is used for the cross-check.
    tune : bool
        Whether to determine the ring's parameters.
    objective : {"frequency", "paper"}
        What the tuning minimises: relative frequency errors, or the residual of eq. 18.
    given : dict
        Ring parameters known from elsewhere, by name, in SI.
    strict : bool
        Whether warnings about the recordings are errors.
    identification : IdentificationSettings, optional
        Thresholds of poles, curve fit and pairs, instead of those of the manifest.
    checks : CheckSettings, optional
        Thresholds of the checks on channels and sensors, instead of those of the manifest.

    Examples
    --------
    >>> import ringmodal as rm
    >>> options = rm.Options(processing=rm.Processing(band_hz=(60.0, 160.0)), tune=False)
    >>> rm.process("sample_data/tyre_225_55R17", options)
    <Result tyre_225_55R17: 4 modes, no ring, 0 warnings>
    """

    processing: Processing = field(default_factory=Processing)
    estimator: str = "H1"
    max_order: int = 60
    pinned_hz: tuple[float, ...] = ()
    excluded_hz: tuple[float, ...] = ()
    method: str = "lsce"
    tune: bool = True
    objective: str = "frequency"
    given: dict[str, float] = field(default_factory=dict)
    strict: bool = False
    identification: IdentificationSettings | None = None
    checks: CheckSettings | None = None


def processing_in_force(campaign: Campaign, chosen: Processing) -> Processing:
    """Combine the manifest's processing with what was chosen on top of it.

    Averages and block length exclude each other: choosing one drops the manifest's other.
    """
    if chosen.averages is not None and chosen.block_seconds is not None:
        found = f"averages {chosen.averages} and block_seconds {chosen.block_seconds:g}"
        raise InputError("processing", found, "each sets the block length", "Leave one of them out")
    if chosen.band_hz is not None and not 0 <= chosen.band_hz[0] < chosen.band_hz[1]:
        found = f"{chosen.band_hz[0]:g} to {chosen.band_hz[1]:g} Hz"
        raise InputError("band_hz", found, "a band rises from 0 Hz or above", "Correct the limits")
    manifest = campaign.processing
    if chosen.averages is not None or chosen.block_seconds is not None:
        manifest = replace(manifest, averages=None, block_seconds=None)
    given = {name: value for name, value in vars(chosen).items() if value is not None}
    if chosen.exponential_window_s is None:
        del given["exponential_window_std_s"]
    return replace(manifest, **given)
