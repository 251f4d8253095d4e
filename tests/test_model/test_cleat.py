"""The cleat test against direct integration, Fourier transforms and conservation laws."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp, trapezoid

from model import Cleat, CleatTest, ForcedRing, ParameterError, RingDamping, Wheel, inertance
from model.cleat import exponential_convolution
from model.parameters import REFITTED_DAMPING, TABLE_4_RING

VISCOUS = RingDamping(686.0, 800.0, 0.0)
ROLLING = ForcedRing(TABLE_4_RING, VISCOUS, 67.3, highest_order=3)
HALF_SINE = Cleat(radial_n_s=-1.0, circumferential_n_s=0.3, duration_s=0.004, contact_rad=0.2)


def integrate(forced, cleat, times, response_rad, frame):
    """Radial acceleration by time stepping of the coupled equations of each harmonic."""
    ring, speed = forced.ring, forced.speed_rad_s
    rho = ring.mass_per_area_kg_m2
    held = speed if forced.frame == "absolute" else 0.0
    turning = speed if frame == "absolute" else 0.0
    force = np.array([cleat.radial_n_s, cleat.circumferential_n_s])
    force = force / (2 * np.pi * ring.mean_radius_m * ring.belt_width_m)
    bed = np.diag([forced.damping.radial_n_s_m3, forced.damping.circumferential_n_s_m3])
    gyroscopic = 2 * rho * speed * np.array([[0, -1], [1, 0]])
    total = np.zeros(times.size)
    for n in range(forced.highest_order + 1):
        terms = forced.terms([n])
        m11, m22, c = (complex(part[0]).real for part in (terms.m11, terms.m22, terms.c))
        stiffness = np.array([[m11, 1j * c], [-1j * c, m22]])

        def slope(t, y, n=n, stiffness=stiffness):
            angle = cleat.contact_rad - held * t
            load = force * np.exp(-1j * n * angle) * cleat.unit_force(np.asarray(t))
            return np.r_[y[2:], (load - (bed + gyroscopic) @ y[2:] - stiffness @ y[:2]) / rho]

        options = {"method": "DOP853", "rtol": 1e-9, "atol": 1e-13}
        during, after = times[times < cleat.duration_s], times[times >= cleat.duration_s]
        start = solve_ivp(
            slope,
            (0, cleat.duration_s),
            np.zeros(4, complex),
            t_eval=np.r_[during, cleat.duration_s],
            **options,
        )
        rest = solve_ivp(
            slope, (cleat.duration_s, times[-1]), start.y[:, -1], t_eval=after, **options
        )
        y = np.hstack([start.y[:, :-1], rest.y])
        acceleration = np.array([slope(*state)[2] for state in zip(times, y.T, strict=True)])
        carried = -1j * n * turning
        seen = acceleration + 2 * carried * y[2] + carried**2 * y[0]
        phase = np.exp(1j * n * (response_rad - turning * times))
        total += (1 if n == 0 else 2) * (seen * phase).real
    return total


@pytest.mark.parametrize(("held", "frame"), [("rotating", "rotating"), ("absolute", "absolute")])
def test_response_agrees_with_direct_integration(held, frame):
    times = np.linspace(0.0, 0.02, 60)
    forced = replace(ROLLING, frame=held)
    found = CleatTest(forced, HALF_SINE).response(times, 1.7, frame=frame)
    stepped = integrate(forced, HALF_SINE, times, 1.7, frame)
    assert np.abs(found - stepped).max() < 1e-6 * np.abs(stepped).max()


@pytest.mark.parametrize("frame", ["rotating", "absolute"])
@pytest.mark.parametrize("direction", ["radial", "circumferential"])
def test_velocity_and_acceleration_are_derivatives_for_the_same_observer(frame, direction):
    test = CleatTest(replace(ROLLING, frame="absolute", damping=REFITTED_DAMPING), HALF_SINE)
    step, t = 1e-6, np.linspace(0.001, 0.02, 15)
    view = {"frame": frame, "direction": direction}
    place = [test.response(t + k * step, 0.9, quantity="displacement", **view) for k in (-1, 0, 1)]
    speed = [test.response(t + k * step, 0.9, quantity="velocity", **view) for k in (-1, 0, 1)]
    found = test.response(t, 0.9, **view)
    np.testing.assert_allclose(
        (place[2] - place[0]) / (2 * step), speed[1], atol=1e-6 * np.abs(speed[1]).max()
    )
    np.testing.assert_allclose(
        (speed[2] - speed[0]) / (2 * step), found, atol=1e-5 * np.abs(found).max()
    )


@pytest.mark.parametrize("held", ["rotating", "absolute"])
@pytest.mark.parametrize("frame", ["rotating", "absolute"])
def test_spectrum_is_the_fourier_transform_of_the_response(held, frame):
    forced = replace(ROLLING, frame=held, damping=REFITTED_DAMPING, highest_order=12)
    test = CleatTest(forced, HALF_SINE)
    rate, lasting = 20000.0, 0.8
    times = np.arange(0.0, lasting, 1 / rate)
    response = test.response(times, 1.7, frame=frame)
    frequency = np.fft.rfftfreq(times.size, 1 / rate)
    band = (frequency > 10) & (frequency < 300)
    numeric = np.fft.rfft(response)[band] / rate
    exact = test.spectrum(frequency[band], 1.7, frame=frame)
    assert np.abs(numeric - exact).max() < 2e-5 * np.abs(exact).max()


@pytest.mark.parametrize("frame", ["rotating", "absolute"])
def test_spectrum_of_a_unit_impulse_is_the_inertance(frame):
    forced = ForcedRing(TABLE_4_RING, VISCOUS, 67.3, highest_order=60, frame=frame)
    lines = np.linspace(5.0, 300.0, 200)
    impulse = CleatTest(forced, Cleat(radial_n_s=1.0))
    found = impulse.spectrum(lines, 1.7, frame=frame)
    np.testing.assert_allclose(found, inertance(forced, lines, 1.7), rtol=1e-8, atol=1e-12)


def test_the_equivalent_viscous_damping_is_close_to_the_loss_factor():
    forced = ForcedRing(TABLE_4_RING, REFITTED_DAMPING, 67.3, highest_order=60)
    lines = np.linspace(50.0, 300.0, 300)
    impulse = CleatTest(forced, Cleat(radial_n_s=1.0))
    exact = inertance(forced, lines, 1.7)
    assert np.abs(impulse.spectrum(lines, 1.7) - exact).max() < 0.01 * np.abs(exact).max()


def test_a_short_half_sine_is_an_impulse_afterwards():
    forced = replace(ROLLING, highest_order=10)
    times = np.linspace(0.02, 0.1, 50)
    options = {"quantity": "displacement"}
    impulse = CleatTest(forced, Cleat(-1.0)).response(times, 1.0, **options)
    short = CleatTest(forced, Cleat(-1.0, duration_s=1e-5)).response(times + 5e-6, 1.0, **options)
    np.testing.assert_allclose(short, impulse, atol=1e-4 * np.abs(impulse).max())


def test_an_impulse_starts_every_harmonic_with_its_momentum():
    forced = ForcedRing(TABLE_4_RING, VISCOUS, highest_order=5)
    test = CleatTest(forced, Cleat(radial_n_s=2.0))
    start = test.response(0.0, 0.0, quantity="velocity")[0]
    mass = 2 * np.pi * 0.33 * 0.19 * TABLE_4_RING.mass_per_area_kg_m2
    assert start == pytest.approx(2.0 / mass * 11, rel=1e-9)
    assert test.response(0.0, 0.0, quantity="displacement")[0] == pytest.approx(0.0, abs=1e-12)


def test_nothing_moves_before_the_blow_and_everything_decays():
    test = CleatTest(replace(ROLLING, highest_order=20), HALF_SINE)
    response = test.response([-0.1, -1e-9, 0.01, 3.0], 1.0)
    np.testing.assert_array_equal(response[:2], 0.0)
    assert abs(response[3]) < 1e-9 * abs(response[2])


def test_both_frames_see_the_same_displacement():
    test = CleatTest(ROLLING, HALF_SINE)
    for time in (0.003, 0.01, 0.05):
        on_tyre = test.response(time, 1.0 - 67.3 * time, quantity="displacement")
        in_space = test.response(time, 1.0, frame="absolute", quantity="displacement")
        np.testing.assert_allclose(on_tyre, in_space, rtol=1e-9)


def test_exponentials_meet_without_a_gap():
    poles = np.array([-20.0 + 300j])
    times = np.array(0.01)
    for gap in (0.0, 1e-8, 1e-3, 0.9, 1.1, 50.0):
        exponent = poles + gap
        step = np.linspace(0, 0.01, 20001)
        integrand = np.exp(poles * (0.01 - step)) * np.exp(exponent * step)
        expected = trapezoid(integrand, step)
        found = exponential_convolution(exponent, poles, times)
        np.testing.assert_allclose(found, expected, rtol=1e-6)


@pytest.mark.parametrize(
    ("call", "where"),
    [
        (lambda: Cleat(duration_s=-1.0), "duration_s"),
        (lambda: Cleat(radial_n_s=np.inf), "radial_n_s"),
        (lambda: CleatTest(replace(ROLLING, wheel=Wheel(12.0, 0.6)), HALF_SINE), "wheel"),
        (
            lambda: CleatTest(
                replace(ROLLING, ring=replace(TABLE_4_RING, belt_width_m=None)), HALF_SINE
            ),
            "belt_width_m",
        ),
        (lambda: CleatTest(ROLLING, HALF_SINE).response(0.0, 0.0, frame="moon"), "frame"),
        (lambda: CleatTest(ROLLING, HALF_SINE).response(0.0, 0.0, quantity="jerk"), "quantity"),
        (lambda: CleatTest(ROLLING, HALF_SINE).response(0.0, 0.0, direction="up"), "direction"),
        (lambda: CleatTest(ROLLING, HALF_SINE).response(np.nan, 0.0), "times_s"),
    ],
)
def test_refusals(call, where):
    with pytest.raises(ParameterError, match=f"^{where}:"):
        call()
