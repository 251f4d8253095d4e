"""Sections at both ends of the report: summary, warnings, origin, definitions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ema.checks.quality import ReferenceCheck
from ema.core.finding import Verdict
from pipelines.report.blocks import Facts, Listing, Paragraph, Section, Table
from pipelines.report.measurement import flatten
from pipelines.results.result import Result
from pipelines.storage.rounding import number

DEFINITIONS = (
    ("Inertance", "FRF of acceleration over force, estimated as H1 = G_xf/G_ff, time e^{+jωt}."),
    (
        "Coherence γ²",
        "Share of the response's power that the force explains linearly, 0 to 1; with one "
        "average it is always 1 and carries no information.",
    ),
    (
        "Pole, frequency, damping ratio",
        "s = −ζω₀ + jω₀√(1−ζ²); the frequency is the undamped |s|/2π, the damping ratio −Re s/|s|.",
    ),
    (
        "Model order",
        "Order of the polynomial from which LSCE takes the poles; physical poles stay where they "
        "are when it grows.",
    ),
    ("Order n", "Number of waves around the circumference."),
    ("Purity", "Share of a shape's power in its order, 0 to 1."),
    ("MPC", "Modal phase collinearity: 1 for a standing wave, towards 0 for a travelling one."),
    ("MPD", "Mean phase deviation of a shape from a real one, in degrees."),
    ("MAC, AutoMAC", "|φᴴψ|²/((φᴴφ)(ψᴴψ)): 1 for shapes that are alike; a set with itself."),
    ("FRAC", "The same of a measured and a fitted FRF over the fitted lines."),
    ("±", "One standard deviation."),
)
REFERENCES = (
    "Bendat, J. S.; Piersol, A. G.: Random Data. Wiley, 2010. (H1, coherence, random errors)",
    "Brown, D. L.; Allemang, R. J.; Zimmerman, R.; Mergeay, M.: Parameter estimation techniques "
    "for modal analysis. SAE 790221, 1979. (LSCE)",
    "Reynders, E.; Houbrechts, J.; De Roeck, G.: Fully automated (operational) modal analysis. "
    "Mechanical Systems and Signal Processing 29, 2012. (clusters, MPD)",
    "Golub, G. H.; Pereyra, V.: The differentiation of pseudo-inverses and nonlinear least squares "
    "problems whose variables separate. SIAM J. Numer. Anal. 10, 1973. (curve fit)",
    "Allemang, R. J.; Brown, D. L.: A correlation coefficient for modal vector analysis. "
    "IMAC, 1982. (MAC)",
    "Pappa, R. S.; Elliott, K. B.; Schenk, A.: Consistent-mode indicator for the eigensystem "
    "realization algorithm. J. Guidance, Control, and Dynamics 16, 1993. (MPC)",
    "Heylen, W.; Lammens, S.: FRAC: a consistent way of comparing frequency response functions. "
    "Int. Conf. on Identification in Engineering Systems, 1996.",
)


def summary(result: Result) -> Section:
    """The main results in a few lines."""
    frac = result.modal_model.frac
    fit = f"median FRAC {np.median(frac):.4f}, lowest {np.min(frac):.4f}"
    verdicts = [finding.verdict for finding in result.findings]
    concerns = (
        ("warnings on data", verdicts.count(Verdict.WARNING)),
        ("channels or runs excluded", verdicts.count(Verdict.EXCLUDED)),
        ("modes with a remark", sum(mode.doubtful for mode in result.modal_model.modes)),
    )
    attention = "; ".join(f"{what}: {count}" for what, count in concerns if count)
    ring = "left out"
    if result.validation is not None:
        error = np.abs(result.validation.error_percent)
        worst = int(np.argmax(error))
        ring = f"largest deviation {error[worst]:.2f} % at n = {result.validation.order[worst]}"
    check = result.reference
    rows = (
        ("Modes", _modes_found(result)),
        ("Fit", fit),
        *([] if check is None else [("Reference sensor", _reference_verdict(check))]),
        ("Ring model", ring),
        ("Attention", attention or "nothing"),
    )
    return Section("summary", "Summary", (Facts(rows),))


def warnings(result: Result) -> Section:
    """Notes that no other section has."""
    listing = listed(remaining_notes(result))
    none = Paragraph("Nothing beyond the notes on modes, ring and data quality.")
    return Section("notes", "Warnings and notes", listing or (none,))


def origin(result: Result) -> Section:
    """Software and input files."""
    provenance = result.provenance
    created = (("Processed", str(provenance["created"])),) if "created" in provenance else ()
    software = tuple(flatten(provenance.get("software", {})).items())
    times = tuple(
        (stage, f"{seconds:.2f}") for stage, seconds in provenance.get("stage_seconds", {}).items()
    )
    blocks = (
        Facts((*created, *software)),
        input_files(result),
        Table("Time of each stage", ("stage", "time / s"), times, (0,), folded=True),
    )
    return Section("origin", "Software and inputs", tuple(each for each in blocks if each.rows))


def input_files(result: Result) -> Table:
    """The files that were read; no rows where they are not known."""
    rows = tuple(
        (str(entry["file"]), str(entry["bytes"]), str(entry["sha256"]))
        for entry in result.provenance.get("inputs", ())
    )
    return Table("Input files", ("file", "bytes", "SHA-256"), rows, (0, 2))


def definitions(_result: Result) -> Section:
    """Terms and references."""
    title = "Definitions and references"
    return Section("definitions", title, (Facts(DEFINITIONS), Listing(REFERENCES)))


def _modes_found(result: Result) -> str:
    modes = result.modal_model.modes
    low, high = result.modal_model.band_hz
    band = f"between {low:.4g} and {high:.4g} Hz"
    if not modes:
        return f"none {band}"
    text = f"{len(modes)} {band}"
    orders = sorted({mode.order for mode in modes if mode.order is not None})
    return f"{text}, orders {', '.join(map(str, orders))}" if orders else text


def _reference_verdict(check: ReferenceCheck) -> str:
    if not np.isfinite(check.ratio):
        return "not assessed, its noise is unknown"
    verdict = "one and the same tyre in all runs" if check.consistent else "the runs differ"
    return f"{verdict} ({number(check.ratio, 3)} times the noise)"


def listed(notes: Sequence[str]) -> tuple[Listing, ...]:
    """The notes as a list; nothing where there are none."""
    return (Listing(tuple(notes)),) if notes else ()


def remaining_notes(result: Result) -> tuple[str, ...]:
    """Notes that no other section shows: those of neither modes nor ring nor damping."""
    shown = set(result.modal_model.notes)
    for part in (result.tuning, result.damping):
        shown |= set(part.notes) if part is not None else set()
    return tuple(note for note in dict.fromkeys(result.notes) if note not in shown)
