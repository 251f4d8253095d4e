"""A campaign of a virtual laboratory, and its truth."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from ema.core.campaign import Campaign, Response, Run, Tyre
from ema.core.recording import FORCE, Channel, Recording
from ema.io.uff.write import write_time_series
from model.parameters import RingDamping, RingParameters
from pipelines.simulate import laboratory_chain as chain
from pipelines.simulate.campaign import (
    POSITIONS,
    REFERENCE,
    REFERENCE_DEG,
    channels_of,
    manifest_text,
    write_text,
)
from pipelines.simulate.laboratory_effects import Effects, readme
from pipelines.simulate.laboratory_tyre import STIFFNESSES, LaboratoryTyre, State, random_ring
from pipelines.simulate.truth import Complexes, Floats, System
from pipelines.storage.atomic import written_whole

TRUTH_DEG = np.arange(POSITIONS) * 360.0 / POSITIONS
HIGHEST_TRUTH_HZ = 600.0
_SAME_POLE = 1e-7  # relative distance below which two poles are one
_STEP = 1e-3  # relative step of the pressure for its effect on the poles


@dataclass(frozen=True, eq=False)
class LaboratoryMode:
    """A mode of the truth.

    Parameters
    ----------
    kind : str
        ``"ring"``, ``"torsion"``, ``"extensional"``, ``"rim"``, ``"lateral"`` or ``"cavity"``.
    order : int
        Circumferential order that has most of the radial shape.
    purity : float
        Share of that order in the power of the radial shape.
    energy_share : float
        Share of the kinetic energy in the coordinates that name the kind.
    frequency_hz, damping_ratio : float
        Undamped frequency and damping ratio of the pole.
    strength : float
        φ² at the force over the modal mass, 1/kg: what the force drives and a sensor there sees.
    shape : ndarray of complex, shape (72,)
        Residues at 0°, 5° … 355°, scaled to a largest magnitude of 1.
    """

    kind: str
    order: int
    purity: float
    energy_share: float
    frequency_hz: float
    damping_ratio: float
    strength: float
    shape: Complexes

    @property
    def pole(self) -> complex:
        """Pole in rad/s."""
        size = 2 * np.pi * self.frequency_hz
        return complex(-self.damping_ratio, np.sqrt(1 - self.damping_ratio**2)) * size


@dataclass(frozen=True, eq=False)
class Truth:
    """What a campaign was made from.

    Parameters
    ----------
    effects : Effects
    ring, damping : RingParameters, RingDamping
        Means around the circumference.
    force_deg : float
        Where the force really acts.
    modes : tuple of LaboratoryMode
        Of the bare tyre in the state of the first run half-way through.
    as_tested : tuple of LaboratoryMode
        The same with sensors and live mass of the first run.
    runs_percent : tuple of float
        Mean shift of the ring modes of each run against the first, percent.
    """

    effects: Effects
    ring: RingParameters
    damping: RingDamping
    force_deg: float
    modes: tuple[LaboratoryMode, ...]
    as_tested: tuple[LaboratoryMode, ...]
    runs_percent: tuple[float, ...]


def modes_of(tyre: LaboratoryTyre, system: System, force_deg: float) -> tuple[LaboratoryMode, ...]:
    """Modes of a system up to `HIGHEST_TRUTH_HZ`; poles that coincide are one mode."""
    residues = system.residues(tyre.surface(np.append(TRUTH_DEG, force_deg)))
    poles = system.poles[np.abs(system.poles) < 2 * np.pi * HIGHEST_TRUTH_HZ]
    apart = np.abs(poles[1:] / poles[:-1] - 1) >= _SAME_POLE
    return tuple(
        _mode(tyre, poles[same[0]], system.vectors[:, same[0]], residues[:, same].sum(axis=1))
        for same in np.split(np.arange(poles.size), np.flatnonzero(apart) + 1)
    )


def _mode(
    tyre: LaboratoryTyre, pole: complex, vector: Complexes, residues: Complexes
) -> LaboratoryMode:
    kind, share = _kind(tyre, vector)
    shape = residues[:-1] / np.abs(residues[:-1]).max()
    lines = np.abs(np.fft.fft(shape)) ** 2
    power = np.bincount(np.abs(np.fft.fftfreq(POSITIONS, 1 / POSITIONS)).astype(int), lines)
    order = int(np.argmax(power))
    purity, size = float(power[order] / power.sum()), float(abs(pole))
    strength = float(2 * size * abs(residues[-1]))
    of_pole = size / (2 * np.pi), float(-pole.real / size)
    return LaboratoryMode(kind, order, purity, share, *of_pole, strength, shape)


def _kind(tyre: LaboratoryTyre, vector: Complexes) -> tuple[str, float]:
    """What moves most, and its share of the kinetic energy."""
    energy = np.real(vector.conj() * (tyre.mass @ vector))
    shares: dict[str, float] = {}
    for (kind, order), part in zip(tyre.labels, energy, strict=True):
        belt = kind in ("radial", "tangential")
        turns = kind == "turning" or (kind == "tangential" and order == 0)
        name = "torsion" if turns else f"ring {order}" if belt else kind
        shares[name] = shares.get(name, 0.0) + float(part)
    name = max(shares, key=lambda key: shares[key])
    share = shares[name] / sum(shares.values())
    if not name.startswith("ring"):
        return name, share
    extended = tyre.extension_share(vector)
    return ("extensional" if extended > 0.5 and name != "ring 0" else "ring"), share


def truth_content(truth: Truth) -> dict[str, Any]:
    """Content of ``truth.json``."""
    effects = truth.effects
    return {
        "schema": 1,
        "seed": effects.seed,
        "options": {k: v for k, v in effects.switched_on.items() if k != "seed"},
        "tyre": asdict(truth.ring) | asdict(truth.damping),
        "force_deg": truth.force_deg,
        "modes": [_mode_content(mode) for mode in truth.modes],
        "as_tested_first_run": [_mode_content(mode) for mode in truth.as_tested],
        "runs_percent": list(truth.runs_percent),
    }


def _mode_content(mode: LaboratoryMode) -> dict[str, Any]:
    content = asdict(mode)
    shape = content.pop("shape")
    return content | {"re": np.round(shape.real, 12).tolist(), "im": shape.imag.round(12).tolist()}


@dataclass(frozen=True, eq=False)
class Laboratory:
    """A tyre on the test stand; everything follows from the effects and their seed.

    Parameters
    ----------
    effects : Effects

    Attributes
    ----------
    tyre : LaboratoryTyre
        The structure, bare.
    truth : Truth
        Its exact modes.

    Examples
    --------
    >>> from pipelines.simulate.laboratory import Laboratory
    >>> from pipelines.simulate.laboratory_effects import Effects
    >>> laboratory = Laboratory(Effects(duration_s=2.0, runs=2, splice=0.01))
    >>> laboratory.campaign()
    <Campaign laboratory: 2 runs with 24 responses, tyre laboratory tyre 1>
    >>> laboratory.truth.modes[1].kind
    'ring'
    """

    effects: Effects
    tyre: LaboratoryTyre = field(init=False)

    def __post_init__(self) -> None:
        ring, damping = random_ring(self.effects.seed)
        factor = self.effects.stiffness
        ring = replace(ring, **{name: factor * getattr(ring, name) for name in STIFFNESSES})
        object.__setattr__(self, "tyre", LaboratoryTyre(ring, damping, self.effects))

    @property
    def name(self) -> str:
        """Designation of the tyre."""
        return f"laboratory tyre {self.effects.seed}"

    @property
    def drive(self) -> Floats:
        """Row of the coordinates at the force of the first run."""
        return self.drive_in(0)

    def drive_in(self, run: int) -> Floats:
        """Row of the coordinates at the force of a run."""
        place = self.declared_deg(run) + self.effects.force_offset_deg
        return np.asarray(self.tyre.surface(np.array([place]))[0])

    @property
    def force_deg(self) -> float:
        """Where the force of the first run really acts."""
        return self.effects.force_deg + self.effects.force_offset_deg

    def declared_deg(self, run: int) -> float:
        """Where the force of a run acts as declared."""
        return self.effects.forces_deg[run // self.effects.runs]

    def progress(self, run: int) -> float:
        """How far the campaign's drift has come half-way through a run: 0 first, 1 last."""
        number = self.effects.all_runs
        if number == 1:
            return 0.0
        steps = np.random.default_rng([self.effects.seed, 2]).uniform(0.5, 1.5, number)
        return float(np.sum(steps[1 : run + 1]) / np.sum(steps[1:]))

    def state(self, run: int) -> State:
        """State of the tyre half-way through a run."""
        effects, progress = self.effects, self.progress(run)
        return State(
            1 + effects.pressure_drift * progress,
            1 + effects.temperature_drift * progress,
            1 + effects.temperature_damping * progress,
        )

    def mounting(self, run: int) -> chain.Mounting:
        """Sensors of a run."""
        effects = self.effects
        declared, actual = _angles_deg(effects, run)
        fixed = np.random.default_rng([effects.seed, 3])
        gain = 1 + effects.gain_error * fixed.standard_normal(declared.size)
        delay = 1e-6 * effects.delay_us * fixed.uniform(0, 1, declared.size)
        reference = fixed.uniform(-1, 1) * effects.angle_error_deg, fixed.standard_normal()
        moved = np.random.default_rng([effects.seed, 4, run])
        errors = effects.angle_error_deg * moved.uniform(-1, 1, declared.size)
        tilt = effects.tilt_deg * moved.standard_normal(declared.size)
        errors[-1], tilt[-1] = reference[0], effects.tilt_deg * reference[1]
        return chain.Mounting(declared, actual + errors, tilt, gain, delay)

    def system(self, run: int) -> System:
        """The tyre as tested in a run, with everything that hangs on it."""
        effects, mounting = self.effects, self.mounting(run)
        drive = self.drive_in(run)
        extra = self.tyre.hung(drive[None, :], effects.live_mass_kg)
        # The stinger decouples its mass from tangential motion; sensors have both inertias.
        for tilt in (0.0, 90.0):
            rows = self.tyre.surface(mounting.actual_deg, tilt)
            extra += self.tyre.hung(rows, effects.sensor_mass_kg)
        return self.tyre.solve(self.state(run), drive, extra)

    def recordings(self, run: int) -> tuple[Floats, Floats]:
        """Force in N, shape (n_samples,), and accelerations in m/s², (n_sensors, n_samples)."""
        (force, found), effects = self.signals(run), self.effects
        random = np.random.default_rng([effects.seed, 6, run])
        force = chain.recorded_force(force, effects, random)
        return force, chain.recorded_responses(found, effects, random)

    def signals(self, run: int) -> tuple[Floats, Floats]:
        """What a perfect chain would record: force and accelerations of a run."""
        driven, effects = self._driven(run), self.effects
        if effects.pressure_drift_within or effects.drift_within or effects.softening:
            found = chain.moving_responses(driven, self._shift(run, driven))
        else:
            found = chain.responses(driven)
        kept = slice(driven.period - effects.n_samples, None)
        return scipy.fft.irfft(driven.spectrum, driven.period)[kept], found[:, kept]

    def _driven(self, run: int) -> chain.Driven:
        effects, mounting, system = self.effects, self.mounting(run), self.system(run)
        omega = chain.frequencies(effects, chain.period_samples(effects))
        spectrum = chain.force_spectrum(effects, np.random.default_rng([effects.seed, 5, run]))
        spectrum *= 10 ** (effects.level_step_db / 20 * run / max(effects.all_runs - 1, 1))
        if effects.shaker:
            drive = system.inertance(self.drive_in(run)[None, :], omega)[0]
            spectrum = chain.with_shaker(spectrum, omega, drive)
        rows = self.tyre.surface(mounting.actual_deg, mounting.tilt_deg)
        return chain.Driven(system, rows, spectrum, omega, mounting)

    def _shift(self, run: int, driven: chain.Driven) -> Complexes:
        """Change of the excited poles over the period, against half-way through the run."""
        effects, poles, period = self.effects, driven.system.poles, driven.period
        poles = poles[np.abs(poles) < 2 * np.pi * effects.band_hz[1]]
        time = (np.arange(period) - period + effects.n_samples / 2) / effects.n_samples
        factor = effects.drift_within * time
        if effects.softening:
            level = chain.level_over_time(chain.responses(driven), effects.sampling_rate_hz)
            factor = factor - effects.softening * (level / self._usual_level - 1)
        shift = poles[:, None] * factor
        if effects.pressure_drift_within:
            state = self.state(run)
            down, up = (
                self.tyre.stiffness(replace(state, pressure=state.pressure + step))
                for step in (-_STEP, _STEP)
            )
            system, slope = driven.system, (up - down) / (2 * _STEP)
            rates = -np.einsum("rc,cd,dr->r", system.left, slope, system.vectors)[: poles.size]
            shift = shift + rates[:, None] * effects.pressure_drift_within * time
        return np.asarray(shift)

    @cached_property
    def _usual_level(self) -> float:
        """Level of the first run, rms over its time."""
        found = chain.responses(self._driven(0))
        return float(np.sqrt(np.mean(found**2)))

    def channels(self, run: int) -> list[Channel]:
        """Channels of a run in single precision: the force, the turned sensors, the reference."""
        force, responses = self.recordings(run)
        return channels_of({FORCE: force}, responses, self.places(run))

    def places(self, run: int) -> dict[str, float]:
        """Declared angle of every sensor of a run, degrees."""
        names = (*(f"A{k + 1:02d}" for k in range(self.effects.sensors)), REFERENCE)
        return dict(zip(names, self.mounting(run).declared_deg.tolist(), strict=True))

    def campaign(self) -> Campaign:
        """The campaign in memory, as `ema.estimate_frf` takes it."""
        effects = self.effects
        runs = []
        for run in range(effects.all_runs):
            name, places = f"run_{run + 1}.uff", self.places(run)
            force, *sensors, reference = channels = self.channels(run)
            responses = tuple(Response(each, each.node, places[each.name]) for each in sensors)
            recording = Recording(Path(name), effects.sampling_rate_hz, tuple(channels))
            node = round(self.declared_deg(run) * POSITIONS / 360.0)
            forces = (Response(force, node, self.declared_deg(run)),)
            moved = forces if effects.further_forces_deg else ()
            runs.append(Run(name, recording, force, responses, reference, forces=moved))
        ring = self.tyre.ring
        return Campaign(
            "laboratory",
            tuple(runs),
            tyre=Tyre(self.name, ring.inflation_pressure_pa, ring.mean_radius_m, ring.belt_width_m),
            positions=POSITIONS,
            excitation_deg=effects.force_deg,
            reference_deg=REFERENCE_DEG,
            sensor_mass_kg=effects.declared_mass_kg or None,
        )

    @property
    def manifest(self) -> str:
        """The campaign as the laboratory declares it, errors not included."""
        ring, effects = self.tyre.ring, self.effects
        places = {f"run_{run + 1}.uff": self.places(run) for run in range(effects.all_runs)}
        return manifest_text(
            *(self.name, ring, effects.sampling_rate_hz, places),
            forces_deg={name: {FORCE: self.declared_deg(run)} for run, name in enumerate(places)},
            sensor_mass_kg=effects.declared_mass_kg,
        )

    @cached_property
    def truth(self) -> Truth:
        """The exact modes."""
        modes = [self.bare_modes(run) for run in range(self.effects.all_runs)]
        ring_hz = [
            np.array([m.frequency_hz for m in run if m.kind == "ring" and 1 <= m.order <= 7])
            for run in modes
        ]
        percent = tuple(
            float(100 * np.mean(now / ring_hz[0] - 1)) if now.size == ring_hz[0].size else np.nan
            for now in ring_hz
        )
        tyre, tested = self.tyre, modes_of(self.tyre, self.system(0), self.force_deg)
        return Truth(
            self.effects, tyre.ring, tyre.damping, self.force_deg, modes[0], tested, percent
        )

    def bare_modes(self, run: int) -> tuple[LaboratoryMode, ...]:
        """Exact modes of the bare tyre half-way through a run."""
        system = self.tyre.solve(self.state(run), self.drive)
        return modes_of(self.tyre, system, self.force_deg)


def simulate_laboratory(folder: Path | str, effects: Effects) -> Path:
    """Write the campaign of a laboratory (universal files, manifest, truth) and return its folder.

    Parameters
    ----------
    folder : Path or str
        New or empty folder. Gets ``run_1.uff`` …, ``campaign.toml``, ``README.md`` and
        ``truth.json``, which the processing never reads; all of them or nothing.
    effects : Effects
        Same effects, same bytes.

    Raises
    ------
    InputError
        If the folder is not empty or cannot be written.

    Examples
    --------
    >>> from pipelines.simulate.laboratory import simulate_laboratory
    >>> from pipelines.simulate.laboratory_effects import Effects
    >>> folder = simulate_laboratory("hammer_test", Effects(excitation="hammer", duration_s=10.0))
    >>> sorted(path.name for path in folder.iterdir())[:3]
    ['README.md', 'campaign.toml', 'run_1.uff']
    """
    folder = Path(folder)
    laboratory = Laboratory(effects)
    with written_whole(folder, marker=None) as partial:
        for run in range(effects.all_runs):
            file = partial / f"run_{run + 1}.uff"
            write_time_series(file, laboratory.channels(run), effects.sampling_rate_hz)
        write_text(partial / "campaign.toml", laboratory.manifest)
        truth = json.dumps(truth_content(laboratory.truth), indent=1)
        write_text(partial / "truth.json", truth + "\n")
        write_text(partial / "README.md", readme(effects))
    return folder


def _angles_deg(effects: Effects, run: int) -> tuple[Floats, Floats]:
    """Angles of the sensors of a run as declared and as they are, the reference last."""
    first, last = effects.circle_deg
    gaps = effects.sensors - (last - first != 360.0)  # on a full circle, the first is also the last
    spacing = (last - first) / gaps
    places, step = (
        first + spacing * np.arange(effects.sensors),
        spacing / effects.runs * (run % effects.runs),
    )
    actual = places - step if effects.mirrored_step else places + step
    if effects.reversed_sequence:
        actual = -places + step
    if effects.offset_run in (0, run + 1):
        actual = actual + effects.offset_deg
    return np.append(places + step, REFERENCE_DEG), np.append(actual, REFERENCE_DEG)
