"""Use from Python: arrays of one's own, short calls, plots, and errors for wrong arguments."""

import numpy as np
import pytest

import ringmodal as rm

ANGLES = np.arange(0.0, 360.0, 30.0)
LINES = np.arange(0.0, 300.0, 0.5)
TRUE_HZ = {1: 80.0, 2: 100.0, 3: 121.0, 4: 145.0}
RING = {"mean_radius_m": 0.33, "inflation_pressure_pa": 2.2e5}
NAN = float("nan")


def receptances():
    """Of a ring with one mode for each order, in m/N, with 1 % noise at the peaks."""
    omega = 2 * np.pi * LINES
    rng = np.random.default_rng(1)
    found = np.zeros((ANGLES.size, LINES.size), complex)
    for order, hz in TRUE_HZ.items():
        own = 2 * np.pi * hz
        modal = 1 / (own**2 - omega**2 + 2j * 0.02 * own * omega)
        found += np.outer(np.cos(order * np.radians(ANGLES)), modal)
    noise = rng.normal(size=found.shape) + 1j * rng.normal(size=found.shape)
    return found + 1e-8 * noise


VALUES = receptances()


@pytest.fixture(scope="module")
def frf():
    return rm.FRF.from_arrays(LINES, VALUES, angles_deg=ANGLES, unit="m/N")


@pytest.fixture(scope="module")
def diagram(frf):
    return rm.build_stability(frf, (20, 200))


@pytest.fixture(scope="module")
def modes(frf, diagram):
    return rm.fit_modes(frf, rm.select_poles(diagram))


def test_arrays_become_modes_with_orders(modes):
    assert [mode.order for mode in modes.modes] == list(TRUE_HZ)
    np.testing.assert_allclose(modes.frequencies_hz, list(TRUE_HZ.values()), rtol=2e-4)


@pytest.mark.parametrize(
    ("unit", "power", "factor"), [("m/N", 2, 1.0), ("(mm/s)/N", 1, 1e-3), ("g/kN", 0, 9.80665e-3)]
)
def test_units_are_converted_to_inertance(unit, power, factor):
    std = np.full(VALUES.shape, 2.0)
    frf = rm.FRF.from_arrays(LINES, VALUES, unit=unit, std=std)
    to_si = factor * (2j * np.pi * LINES) ** power
    np.testing.assert_allclose(frf.values, VALUES * to_si, rtol=1e-12)
    np.testing.assert_allclose(frf.std, std * np.abs(to_si), rtol=1e-12)
    assert frf.node.tolist() == list(range(1, 13))


def test_frequencies_alone_say_which_modes(frf):
    found = rm.fit_modes(frf, hz=[80.0, 121.0])
    np.testing.assert_allclose(found.frequencies_hz, [80.0, 121.0], rtol=1e-3)


def test_averages_are_a_short_way_to_a_processing(short_campaign):
    campaign = rm.read_campaign(short_campaign)
    short = rm.estimate_frf(campaign, averages=10)
    long = rm.estimate_frf(campaign, rm.Processing(averages=10))
    np.testing.assert_array_equal(short.values, long.values)


def test_modes_are_tuned_as_in_a_whole_process(sample_result):
    tyre = sample_result.tyre
    tuned = rm.tune_ring(
        sample_result.modal_model,
        mean_radius_m=tyre.mean_radius_m,
        inflation_pressure_pa=tyre.inflation_pressure_pa,
        belt_width_m=tyre.belt_width_m,
    )
    assert tuned.how == sample_result.tuning.how
    np.testing.assert_allclose(tuned.model_hz, sample_result.tuning.model_hz, rtol=1e-6)


def test_a_result_saves_itself(sample_result, tmp_path):
    sample_result.save(tmp_path / "kept", report=False)
    assert len(rm.load(tmp_path / "kept").modal_model.modes) == len(sample_result.modal_model.modes)


def test_everything_is_drawn_on_axes_and_returns_them(frf, diagram, modes, sample_result):
    from matplotlib import pyplot

    _, ax = pyplot.subplots()
    assert frf.plot(ax) is ax
    assert ax.get_xlabel() == "frequency / Hz"
    low, high = ax.get_xlim()
    assert 20 <= low < high <= 300
    assert len(frf.plot(angles_deg=[0, 92]).lines) == 2
    assert diagram.plot().get_ylabel() == "model order"
    assert len(modes.plot()) == len(modes.modes)
    assert "80" in modes.plot(mode=1).get_title()
    assert sample_result.tuning.plot().get_xlabel() == "order n"
    pyplot.close("all")


def test_the_coherence_of_a_view_is_that_of_its_band():
    coherence = np.where(LINES < 200, 0.99, 0.1) * np.ones(VALUES.shape)
    frf = rm.FRF.from_arrays(LINES, VALUES, unit="m/N", angles_deg=ANGLES, coherence=coherence)
    low, high = frf.default_band_hz()
    assert (low, high) == (20.0, pytest.approx(200, abs=10))
    assert "0.9900" in frf._repr_html_()


WRONG = {
    "frequencies by rows": lambda f, d, m: rm.FRF.from_arrays(LINES, VALUES.T),
    "a magnitude": lambda f, d, m: rm.FRF.from_arrays(LINES, np.abs(VALUES)),
    "falling lines": lambda f, d, m: rm.FRF.from_arrays(LINES[::-1], VALUES),
    "uneven lines": lambda f, d, m: rm.FRF.from_arrays(LINES**2, VALUES),
    "NaN": lambda f, d, m: rm.FRF.from_arrays(LINES, VALUES * NAN),
    "radians": lambda f, d, m: rm.FRF.from_arrays(LINES, VALUES, angles_deg=np.radians(ANGLES)),
    "an angle too few": lambda f, d, m: rm.FRF.from_arrays(LINES, VALUES, angles_deg=ANGLES[1:]),
    "an angle twice": lambda f, d, m: rm.FRF.from_arrays(LINES, VALUES, angles_deg=2 * ANGLES),
    "force over motion": lambda f, d, m: rm.FRF.from_arrays(LINES, VALUES, unit="N/m"),
    "coherence above 1": lambda f, d, m: rm.FRF.from_arrays(
        LINES, VALUES, coherence=2 + 0 * VALUES
    ),
    "arrays that do not fit": lambda f, d, m: rm.FRF([1, 2], [[1, 2]], [[1]], [[1]], [1], [1], "a"),
    "no FRFs": lambda f, d, m: rm.build_stability("result"),
    "one end": lambda f, d, m: rm.build_stability(f, 300),
    "ends swapped": lambda f, d, m: rm.identify_modes(f, (300, 20)),
    "settings": lambda f, d, m: rm.build_stability(f, settings=5),
    "an order too many": lambda f, d, m: rm.build_stability(f, max_order=10**9),
    "pins that are words": lambda f, d, m: rm.identify_modes(f, pinned_hz="abc"),
    "FRFs for a diagram": lambda f, d, m: rm.select_poles(f),
    "frequencies for poles": lambda f, d, m: rm.fit_modes(f, [80.0, 100.0]),
    "no poles": lambda f, d, m: rm.fit_modes(f, []),
    "a mass alone": lambda f, d, m: rm.identify_modes(f, (20, 200), sensor_mass=0.004),
    "a file for a campaign": lambda f, d, m: rm.estimate_frf("result"),
    "a number for a campaign": lambda f, d, m: rm.read_campaign(5),
    "no radius": lambda f, d, m: rm.tune_ring(m, inflation_pressure_pa=2.2e5),
    "bar": lambda f, d, m: rm.tune_ring(m, mean_radius_m=0.33, inflation_pressure_pa=2.2),
    "millimetres": lambda f, d, m: rm.tune_ring(m, mean_radius_m=330, inflation_pressure_pa=2.2e5),
    "words for frequencies": lambda f, d, m: rm.tune_ring([1, 2, 3], ["a"] * 3, **RING),
    "nothing to tune to": lambda f, d, m: rm.tune_ring([], [], **RING),
    "orders alone": lambda f, d, m: rm.tune_ring([1, 2, 3], **RING),
    "a start without values": lambda f, d, m: rm.tune_ring([1, 2, 3], [1, 2, 3], start="x", **RING),
    "an unknown argument": lambda f, d, m: rm.tune_ring(m, radius=0.33, **RING),
    "shapes of two lengths": lambda f, d, m: rm.mac([1, 2], [1, 2, 3]),
    "a model for its shapes": lambda f, d, m: rm.mac(m, m),
    "several shapes": lambda f, d, m: rm.mpc([[1, 2], [3, 4]]),
    "FRFs of two lengths": lambda f, d, m: rm.frac([1, 2], [1, 2, 3]),
    "modes for a result": lambda f, d, m: rm.save(m, "nowhere"),
    "a number for a folder": lambda f, d, m: rm.load(5),
    "options as text": lambda f, d, m: rm.process("nowhere", "fast"),
    "a mode that is not there": lambda f, d, m: m.plot(mode=0),
    "a band without lines": lambda f, d, m: f.plot(band_hz=(900, 950)),
    "no axes": lambda f, d, m: f.plot("here"),
    "a ring that is none": lambda f, d, m: rm.natural_frequencies_hz(None, [2]),
}


@pytest.mark.parametrize("call", WRONG.values(), ids=WRONG)
def test_wrong_arguments_are_named(call, frf, diagram, modes):
    with pytest.raises((rm.InputError, rm.ParameterError)) as caught:
        call(frf, diagram, modes)
    assert caught.value.remedy


@pytest.mark.parametrize(
    "choice",
    [
        *({"averages": value} for value in (0, -3, "10", 1.5, NAN)),
        *({"block_seconds": value} for value in (0, -1, "4", NAN, 1e9)),
        *({"overlap": value} for value in (1, -1, "x", NAN)),
        *({"window": value} for value in ("foo", 5)),
        {"estimator": "H9"},
    ],
    ids=str,
)
def test_wrong_choices_of_blocks_are_named(choice, short_campaign):
    campaign = rm.read_campaign(short_campaign)
    with pytest.raises(rm.InputError):
        rm.estimate_frf(campaign, **choice)
