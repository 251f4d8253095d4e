"""Findings: the result of one check."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

from ema.core.display import as_typed, table


class Verdict(StrEnum):
    """What a finding means for the result."""

    OK = "ok"
    WARNING = "warning"
    EXCLUDED = "excluded"


class Check(StrEnum):
    """What was checked: the name in ``quality.csv``, and its `meaning`."""

    meaning: str

    def __new__(cls, name: str, meaning: str) -> Check:
        """Make the member that equals its name."""
        member = str.__new__(cls, name)
        member._value_, member.meaning = name, meaning
        return member

    # files
    CONTENT = "content", "parts of a file that were not read"
    IGNORED = "ignored", "columns and channels that were not used"
    SEGMENTS = "segments", "further segments of a LabVIEW file, which were not read"
    BYTE_COUNT = "byte count", "bytes stated in a universal file against those it has"
    GEOMETRY = "geometry", "positions that the geometry of a universal file does not give"
    QUANTITY = "quantity", "FRFs converted to inertance"
    RECIPROCITY = (
        "reciprocity",
        "FRFs of a moved force, taken as those of moved sensors; responses at one of several "
        "forces to another against the reverse",
    )
    UNIT = "unit", "units that are not stated, not known or assumed"
    SAMPLING_RATE = "sampling rate", "a rate that the file does not state, or not exactly"
    START = "start", "channels that start or end at different times, cut to what they share"
    NAME = "name", "channels with the same name"
    # campaign
    CALIBRATION = "calibration", "units and sensitivities set by the manifest"
    NODE = "node", "node numbers assumed, as the files have none"
    GRID = "grid", "positions off the grid, not measured or measured repeatedly"
    DIRECTION = "direction", "sensors that are not radial"
    LENGTH = "length", "duration of a run against the others"
    # signals
    LEVEL = "level", "level of a signal against what its unit makes plausible"
    MISSING_SAMPLES = "missing samples", "samples that are no numbers, and averages left out"
    IMPOSSIBLE_SAMPLES = "impossible samples", "single samples far beyond all others"
    SILENT = "silent", "channels without signal"
    CLIPPED = "clipped", "samples at the limits of the signal"
    DROPOUT = "dropout", "one value held over a long part of a signal"
    STUCK = "stuck", "one value held while the other channels move"
    REPEATED = "repeated", "parts of a recording that were written twice"
    COUNTER = "counter", "gaps and repetitions shown by a sample counter"
    LOST_SAMPLES = "lost samples", "samples lost in one or all channels"
    # FRFs
    PERIOD = "period", "block length against the period of the force"
    EXCITATION = "excitation", "runs whose force is far below that of the others"
    WINDOW = (
        "window",
        "windows that headers state, and a declared one against the noise of recordings",
    )
    DOUBLE_HITS = "double hits", "hammer hits with more than one pulse"
    AVERAGES = "averages", "number of averages"
    COHERENCE = "coherence", "median coherence in the band"
    HUM = "hum", "lines of the mains"
    REFERENCE = "reference", "fixed reference sensor over the runs"
    GAIN = "gain", "runs whose FRFs differ from those of the other runs by one factor"
    DEAD = "dead", "channels far weaker than the others"
    INCOHERENT = "incoherent", "channels with far less coherence than the others"
    AVERAGED_RUNS = "averaged runs", "agreement of runs averaged at one position"
    # modes
    BAND = "band", "band of the modes, where the user gave none"
    WITHIN_RUN = "within run", "frequencies at the end of a run against its start"
    LEVEL_DEPENDENCE = "level dependence", "frequencies at higher level against those at lower"
    DRIFT = "drift", "frequencies and damping of each run against the first"
    FLIPPED = "flipped", "inverted polarity, corrected"
    SCALED = "scaled", "wrong gain, corrected"
    SWAPPED = "swapped", "two sensors swapped, corrected"
    INCONSISTENT = "inconsistent", "sensors or runs that contradict the modes"
    BY_HAND = "by hand", "rows of the FRFs changed, left out or brought back by a person"
    CORRECTIONS_WITHHELD = "corrections withheld", "corrections of sensors that were not made"
    POSITIONS = "positions", "angles of the sensors against the shapes of the modes"
    FORCES = "forces", "several forces: identified together, their driving points, changes between"
    DRIVE_POINT = "drive point", "position and sign of the force against the modes"
    PLAUSIBILITY = "plausibility", "tuned ring against what tyres have"
    MASS = "mass", "masses that are stated and were not compensated"
    AMPLITUDE = "amplitude", "amplitude of the modes against the mass of the ring"
    RING = "ring", "whether a ring describes the tyre"
    CHANGED = "changed", "parts of a result changed after it was written"


@dataclass(frozen=True)
class Finding:
    """One line of ``quality.csv``."""

    run: str  # empty where it concerns the whole campaign
    channel: str  # empty where it concerns the whole run
    position_deg: float | None  # where the channel sits
    check: Check
    verdict: Verdict
    detail: str  # the number found and the rule, in words

    @property
    def is_ok(self) -> bool:
        """Whether nothing is doubtful or left out."""
        return self.verdict is Verdict.OK


def findings_html(findings: Sequence[Finding]) -> str:
    """Findings that are not in order; nothing where all are."""
    rows = [
        (each.verdict, each.run, each.channel, as_typed(each.position_deg, "°"), each.detail)
        for each in findings
        if not each.is_ok
    ]
    head = ("verdict", "run", "channel", "position", "what was found")
    return table("Warnings", head, rows, words=(0, 1, 2, 4)) if rows else ""
