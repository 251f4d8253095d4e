"""Modes from FRFs: by selected poles, by frequencies, or by the automatic selection."""

from __future__ import annotations

from numpy.typing import ArrayLike

from ema.core.bands import NO_FRF, frequencies_of
from ema.core.edits import shorthand
from ema.core.errors import InputError, require_type
from ema.core.frf import FRF
from ema.core.modes import ModalModel
from ema.core.numerics import one_blas_thread
from ema.core.settings import IDENTIFICATION, IdentificationSettings
from ema.fitting.curve_fit import settled
from ema.fitting.edited_fit import EditedFit, edited
from ema.fitting.search import curve_fit
from ema.poles.selection import PoleSelection, select_poles
from ema.poles.stability import StabilityDiagram, build_stability


@one_blas_thread
def fit_modes(
    frf: FRF,
    poles: PoleSelection | ArrayLike | None = None,
    band_hz: tuple[float, float] | None = None,
    settings: IdentificationSettings = IDENTIFICATION,
    *,
    hz: ArrayLike | None = None,
) -> ModalModel:
    """Fit poles, residues and residual terms to all FRFs at once.

    Weighted least squares with 1/σ, the noise level of the FRFs over frequency and position;
    poles move within bounds around their start values. Where the FRFs come from blocks of a
    random excitation, the bias of the window is compensated. Where the natural frequencies differ
    from run to run by more than chance, each run gets its own state: shapes stay common, all
    frequencies of a run move together, and the result is that of the first run.

    Parameters
    ----------
    frf : FRF
    poles : PoleSelection or array_like of complex, optional
        From `select_poles`, or poles in rad/s. Default: the automatic selection.
    band_hz : tuple of float, optional
        Band of the result; by default that of the selection, or where coherence is good.
    settings : IdentificationSettings
    hz : array_like, optional
        List only the modes at these frequencies in Hz. The others of the band are fitted too, so
        that their response is not pressed into these.

    Returns
    -------
    ModalModel

    Raises
    ------
    InputError
        If an argument cannot be used.
    FitError
        If no pole lies in the band, none at a frequency of `hz`, or the fit diverges.

    Examples
    --------
    >>> import ringmodal as rm
    >>> frf = rm.estimate_frf(rm.read_campaign("sample_data/tyre_225_55R17"))
    >>> frf = frf.rows(range(0, 72, 6))  # every 30°, to be quick
    >>> rm.fit_modes(frf, hz=[78.7, 100.3]).frequencies_hz.round(1)
    array([ 78.7, 100.3])
    """
    require_type("frf", frf, FRF, NO_FRF)
    require_type("settings", settings, IdentificationSettings, "Leave it out")
    pinned = None if hz is None else frequencies_of("hz", hz)
    if poles is None:
        band_hz = band_hz or _around(frf, pinned or ())
        selection = select_poles(build_stability(frf, band_hz, settings=settings))
    elif pinned is not None:
        rule = "modes are given by their poles or by their frequencies"
        raise InputError("fit_modes", "poles and hz", rule, "Leave one of them out")
    else:
        selection = poles if isinstance(poles, PoleSelection) else PoleSelection.around(poles)
    curve = curve_fit(frf, selection, band_hz or selection.band_hz, settings)
    fit = EditedFit(curve, settled(curve))
    if pinned is None:
        return fit.model

    def diagram(method: str | None) -> StabilityDiagram:
        return build_stability(frf, selection.band_hz, method=method or "lsce", settings=settings)

    return edited(fit, shorthand(pinned), diagram).model


def _around(frf: FRF, hz: tuple[float, ...]) -> tuple[float, float]:
    """The band of views, widened to some frequencies and a fifth beyond."""
    low, high = frf.shown_band_hz()
    far = min(max([high, *(1.2 * each for each in hz)]), float(frf.frequency_hz[-1]))
    return min([low, *(0.8 * each for each in hz)]), far
