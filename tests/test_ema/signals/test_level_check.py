"""Levels that make no sense for their unit are named with the likely unit; sound ones are not."""

from pathlib import Path

import numpy as np
import pytest

from ema.core.recording import ACCELERATION, FORCE, Channel, Recording
from ema.core.units import parse_unit
from ema.io.formats import read_file
from ema.signals.signal_checks import level_findings, summarise
from pipelines.simulate.campaign import simulate_campaign

DATA = Path(__file__).parents[4] / "shared" / "data" / "real"
RATE_HZ = 2000.0


def noise(n=200_000):
    samples = np.random.default_rng(5).normal(size=n)
    return samples / samples.std()


def recording(samples, unit, quantity=None):
    known = parse_unit(unit)
    quantity = quantity or known.quantity
    factor = 1.0 if known is None else known.factor
    return Recording(Path("run.uff"), RATE_HZ, (Channel("A01", quantity, unit, samples, factor),))


def detail(samples, unit, quantity=None):
    found = level_findings(recording(samples, unit, quantity))
    assert [(f.run, f.channel, f.check, f.verdict) for f in found] == [
        ("run.uff", "A01", "level", "warning")
    ]
    return found[0].detail


@pytest.mark.parametrize(
    ("number", "unit", "likely"),
    [
        (500.0, "g", "if the numbers are m/s^2 rather than g, it is 500 m/s^2"),
        (1e5, "g", "if the numbers are mm/s^2 rather than g, it is 100 m/s^2"),
        (2000.0, "m/s^2", "if the numbers are mm/s^2 rather than m/s^2, it is 2 m/s^2"),
        (2.0, "mm/s^2", "if the numbers are g rather than mm/s^2, it is 19.61 m/s^2"),
        (0.001, "N", "if the numbers are kN rather than N, it is 1 N"),
        (20.0, "kN", "if the numbers are N rather than kN, it is 20 N"),
        (5.0, "mN", "if the numbers are N rather than mN, it is 5 N"),
    ],
)
def test_the_likely_unit_is_named(number, unit, likely):
    assert likely in detail(number * noise(), unit)


def test_the_message_says_what_is_usual():
    assert detail(500 * noise(), "g").startswith(
        "4903 m/s^2 rms, where 0.01 to 1000 m/s^2 are usual for a tyre; "
    )
    assert detail(0.001 * noise(), "N").endswith("it is 1 N, if the sensor is connected")


def test_a_level_that_no_unit_explains():
    assert detail(1e12 * noise(), "g").endswith("; check unit and sensitivity")
    assert detail(1e4 * noise(), "V", ACCELERATION).endswith("; check unit and sensitivity")


def test_channels_without_a_unit_are_taken_as_si():
    assert "if the numbers are N rather than" not in detail(1e-3 * noise(), "", FORCE)
    assert "kN rather than N" in detail(1e-3 * noise(), "", FORCE)


@pytest.mark.parametrize("unit", ["g", "m/s^2", "N", "lbf"])
@pytest.mark.parametrize("number", [0.06, 1.0, 25.0])
def test_usual_levels_are_not_remarked_on(unit, number):
    assert level_findings(recording(number * noise(), unit)) == []


def test_the_preload_and_its_sign_do_not_count():
    assert level_findings(recording(-5000 + noise(), "N")) == []


def test_a_dead_or_unknown_channel_is_not_judged():
    assert level_findings(recording(np.full(9000, 1e6), "g")) == []
    assert level_findings(recording(np.full(9000, np.nan), "g")) == []
    assert level_findings(recording(np.zeros(0), "g")) == []
    assert level_findings(recording(1e9 * noise(), "Pa", "unknown")) == []
    assert level_findings(recording(1e9 * noise(), "V")) == []


def test_an_impact_between_the_pieces_is_seen():
    samples = 1e-4 * noise(2_000_000)
    samples[777_777] = 50.0
    assert level_findings(recording(samples, "N")) == []


def test_known_summaries_are_used():
    loud = recording(500 * noise(), "g")
    known = [summarise(loud.channels[0])]
    assert level_findings(loud, known) == level_findings(loud)


class _Counting:
    """Samples that count how many of them are read."""

    def __init__(self, samples):
        self.samples, self.read = samples, 0
        self.shape = samples.shape

    def __getitem__(self, key):
        self.read += self.samples[key].size
        return self.samples[key]


def test_little_is_read_of_a_sound_recording():
    samples = _Counting(noise(1_000_000))
    assert level_findings(recording(samples, "m/s^2")) == []
    assert samples.read == 4 * 4096


def test_no_alarm_on_the_sample_campaign(sample_campaign):
    for path in sample_campaign.glob("*.uff"):
        assert level_findings(read_file(path).recording) == []


@pytest.mark.parametrize("force_n", [1.0, 100.0])
def test_no_alarm_on_weak_and_strong_shakers(tmp_path, force_n):
    folder = simulate_campaign(tmp_path / "campaign", duration_s=2.0)
    content = read_file(folder / "config_1.uff").recording
    usual = next(channel for channel in content.channels if channel.quantity == FORCE)
    factor = force_n / summarise(usual).rms_ac
    channels = tuple(
        Channel(c.name, c.quantity, c.unit, c.samples, c.scale_to_si * factor)
        for c in content.channels
    )
    assert level_findings(Recording(content.path, RATE_HZ, channels)) == []


@pytest.mark.parametrize("path", ["plate_sweep/run_1.uff", "beam_impact/acceleration.lvm"])
def test_no_alarm_on_measured_data(path):
    if not (DATA / path).exists():
        pytest.skip("measured data are not at hand")
    content = read_file(DATA / path).recording
    assert len(content.channels) == 2
    assert level_findings(content) == []
