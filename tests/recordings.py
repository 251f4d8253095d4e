"""A run of known modes with noise, and what happens to recordings: blocks lost, doubled, held."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import systems
from scipy.signal import butter, sosfilt

from ema.core.recording import UNKNOWN, Channel

RATE_HZ = 1000.0
N = 16_000
N_SENSORS = 5
POLES = systems.pole(np.array([62.0, 110.0, 165.0]), np.array([0.03, 0.02, 0.02]))
RESIDUES = np.outer([1.0, -0.8, 0.6, 0.9, -0.7], systems.residue(POLES)) * [
    [1, 1, 1],
    [1, -1, 1],
    [-1, 1, 1],
    [1, 1, -1],
    [1, -1, -1],
]


def shaker_noise(n=N, seed=1):
    """Random force of 10 N in 10 to 400 Hz, on a preload."""
    band = butter(4, [10, 400], "bandpass", fs=RATE_HZ, output="sos")
    force = sosfilt(band, systems.white(n + 500, seed))[500:]
    return 50 + 10 * force / force.std()


def answers(force, seed=2, noise=0.02):
    """What the sensors see; the force goes on before and after, as it ends."""
    moving = force - np.median(force)
    motion = systems.responses_to(moving, RATE_HZ, POLES, RESIDUES)
    return motion + noise * motion.std() * systems.white(force.size, seed, N_SENSORS)


def run(force, motion, name="run_1.uff", **options):
    """A run in single precision; the last sensor is the reference."""
    force, motion = np.asarray(force, np.float32), np.asarray(motion, np.float32)
    angles = np.arange(len(motion) - 1) * 30.0
    return systems.run_of(
        force, motion[:-1], RATE_HZ, name=name, position_deg=angles, reference=motion[-1], **options
    )


def healthy(seed=1, **options):
    force = shaker_noise(seed=10 * seed)
    return run(force, answers(force, 10 * seed + 1), **options)


def edited(built, change, names=None):
    """The run with `change` applied to the samples of all or of the named channels."""

    def done(channel):
        touched = names is None or channel.name in names
        return replace(channel, samples=change(channel.samples.copy())) if touched else channel

    return replace(
        built,
        recording=replace(
            built.recording, channels=tuple(done(each) for each in built.recording.channels)
        ),
        force=done(built.force),
        responses=tuple(replace(each, channel=done(each.channel)) for each in built.responses),
        reference=done(built.reference),
    )


def held(start, n, value=None):
    def change(samples):
        samples[start : start + n] = samples[start] if value is None else value
        return samples

    return change


def copied(start, n, to):
    """Some samples written once more over later ones."""

    def change(samples):
        samples[to : to + n] = samples[start : start + n]
        return samples

    return change


def doubled(start, n):
    """A block that is there twice in a row; what follows comes later."""
    return lambda samples: np.insert(samples, start + n, samples[start : start + n])


def lost(start, n=1):
    """Samples that were dropped; the channel is filled up at its end."""
    return lambda samples: np.append(np.delete(samples, np.s_[start : start + n]), samples[-n:])


def in_steps(built, bits=12, headroom=4.0):
    """As a converter of few bits records it."""

    def change(samples):
        step = headroom * samples.std() / 2 ** (bits - 1)
        return (np.round(samples / step) * step).astype(np.float32)

    return edited(built, change)


def with_counter(built, counts):
    """With a channel that counts the samples."""
    counter = Channel("counter", UNKNOWN, "", np.asarray(counts, float))
    recording = replace(built.recording, channels=(counter, *built.recording.channels))
    return replace(built, recording=recording)
