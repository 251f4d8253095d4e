"""Several forces on structures of any form: repeated roots, close pairs, modal masses."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import subspace_angles

import ringmodal as rm
from ema.core.edits import Edit, EditKind, PoleName
from ema.core.errors import InputError
from ema.core.finding import Check
from ema.core.modes import Chosen
from ema.core.references import References
from ema.refit import refit_modes

LINES_HZ = np.arange(1, 601) / 8
BAND_HZ = (5.0, 62.0)
GRID = (np.arange(6) + 0.5) / 6
MASS_KG = 2.0


def plate(stretched=0.0):
    """Frequencies and shapes of a simply supported plate, square if not stretched."""
    numbers = [(1, 1), (1, 2), (2, 1), (2, 2), (1, 3), (3, 1)]
    hz = np.array([5.0 * (a * a + b * b * (1 + stretched)) for a, b in numbers])
    shapes = [np.outer(np.sin(np.pi * a * GRID), np.sin(np.pi * b * GRID)) for a, b in numbers]
    return hz, np.array(shapes).reshape(len(numbers), -1)


def frfs_of(hz, shapes, forces, *, ratio=0.01, noise=1e-3, gain=1.0):
    """FRFs against forces at some rows; the last one is as strong as `gain` makes it."""
    rng, omega, found = np.random.default_rng(3), 2 * np.pi * LINES_HZ, []
    own = 2 * np.pi * hz[:, None]
    answers = -(omega**2) / (own**2 - omega**2 + 2j * ratio * own * omega)
    for at in forces:
        exact = (shapes * shapes[:, at, None] / MASS_KG).T @ answers
        exact *= gain if at == forces[-1] else 1.0
        std = noise * np.abs(exact).max()
        values = exact + std * (rng.standard_normal((2, *exact.shape)).T @ [1, 1j]).T
        nodes, known = np.arange(1, len(exact) + 1), np.full(exact.shape, max(std, 1e-9))
        frf = rm.FRF.from_arrays(LINES_HZ, values, nodes=nodes, std=known)
        found.append(replace(frf, force_node=at + 1))
    return References(tuple(found))


@pytest.fixture(scope="module")
def square():
    hz, shapes = plate()
    return hz, shapes, rm.identify_modes(frfs_of(hz, shapes, (8, 13)), BAND_HZ)


def plane_of(modes, shapes):
    """Least MAC between what modes and true shapes span."""
    seen = np.array([mode.shape.real for mode in modes]).T
    return np.cos(subspace_angles(seen, shapes.T)[0]) ** 2


def test_a_square_plate_has_both_shapes_of_its_repeated_roots(square):
    hz, shapes, found = square
    assert [round(mode.frequency_hz, 1) for mode in found.model.modes] == [10, 25, 25, 40, 50, 50]
    for rows in ([1, 2], [4, 5]):
        modes = [found.model.modes[k] for k in rows]
        assert plane_of(modes, shapes[rows]) > 0.999
        assert abs(modes[0].frequency_hz - hz[rows[0]]) < 3 * modes[0].frequency_std_hz
        assert min(mode.mpc for mode in modes) > 0.99
    alone = rm.identify_modes(found.references[0].measured, BAND_HZ)
    assert len(alone.model.modes) == 4


def test_nothing_but_rounding_tells_no_shapes_apart():
    hz, shapes = plate()
    found = rm.identify_modes(frfs_of(hz, shapes, (8, 13), noise=0.0), BAND_HZ)
    assert len(found.model.modes) == 6
    assert plane_of(found.model.modes[1:3], shapes[1:3]) > 1 - 1e-9


def test_driving_points_give_modal_masses(square):
    _, shapes, found = square
    for k in (0, 3):
        mode = found.model.modes[k]
        scaled = MASS_KG * (mode.shape.real @ shapes[k] / np.sum(shapes[k] ** 2)) ** 2
        assert abs(mode.modal_mass_kg - scaled) < 4 * mode.modal_mass_std_kg
        assert mode.modal_mass_std_kg < 0.02 * scaled
        assert mode.modal_mass_spread < 0.02
    assert {"modal_mass_kg", "modal_mass_std_kg"} <= set(found.model.to_frame().columns)


def test_a_force_that_is_measured_too_large_is_named():
    hz, shapes = plate(0.1)
    found = rm.identify_modes(frfs_of(hz, shapes, (8, 13), gain=1.5), BAND_HZ)
    doubts = [each for each in found.findings if not each.is_ok]
    assert Check.FORCES in {each.check for each in doubts}


@pytest.mark.parametrize("method", ["lsce", "plscf"])
def test_a_pair_that_one_force_sees_as_one_mode_is_told_apart(method):
    """As the aircraft model with three fixed sensors: 125.21 and 125.58 Hz, in proportion."""
    hz, shapes = plate(0.2)
    hz = np.where(np.arange(hz.size) == 2, hz[1] * 125.58 / 125.21, hz)
    found = rm.identify_modes(frfs_of(hz, shapes, (8, 13, 21)), BAND_HZ, method=method)
    pair = found.model.modes[1:3]
    for mode, k in zip(pair, (1, 2), strict=True):
        assert abs(mode.frequency_hz - hz[k]) < 4 * mode.frequency_std_hz < 0.02
        assert rm.mac(mode.shape, shapes[k])[0, 0] > 0.999
    assert all(opinion.agrees for opinion in found.opinions)
    assert found.diagram.participation.shape == (found.diagram.poles.size, 3)


def test_what_a_force_does_not_drive_is_among_its_modes():
    """Each force is on a node line of one mode."""
    hz, shapes = plate(0.1)
    shapes[1, 8] = shapes[2, 13] = 0.0
    found = rm.identify_modes(frfs_of(hz, shapes, (8, 13)), BAND_HZ)
    assert np.allclose(found.model.frequencies_hz, np.sort(hz), atol=0.05)
    order = np.argsort(hz)
    macs = [rm.mac(m.shape, shapes[k])[0, 0] for m, k in zip(found.model.modes, order, strict=True)]
    assert min(macs) > 0.99


def test_a_channel_that_one_force_lacks_has_the_shape_of_the_others():
    hz, shapes = plate(0.1)
    first, second = frfs_of(hz, shapes, (8, 13))
    found = rm.identify_modes([first, second.rows(np.arange(1, 36))], BAND_HZ)
    order = np.argsort(hz)
    for mode, k in zip(found.model.modes, order, strict=True):
        assert mode.residues.size == 36
        assert rm.mac(mode.shape, shapes[k])[0, 0] > 0.999
    assert len(found.references[1].model.modes[0].residues) == 35


def test_forces_on_different_positions_stay_by_themselves():
    hz, shapes = plate(0.1)
    first, second = frfs_of(hz, shapes, (8, 13))
    other = replace(second, node=second.node + 100)
    found = rm.identify_modes([first, other], BAND_HZ)
    assert Check.FORCES in {each.check for each in found.findings if not each.is_ok}
    assert len(found.model.modes) == len(rm.identify_modes(first, BAND_HZ).model.modes)


def test_a_mode_that_a_moved_shaker_shifts_is_one_mode():
    """The mass of the shaker lowers each mode as far as it moves there: two poles, one shape."""
    hz, shapes = plate(0.1)
    frfs = []
    for run, at in enumerate((8, 13)):
        lowered = hz * (1 - 2e-3 * shapes[:, at] ** 2)
        (frf,) = frfs_of(lowered, shapes, (at,))
        frfs.append(replace(frf, run=(f"run {run}",) * frf.n_positions))
    found = rm.identify_modes(frfs, BAND_HZ)
    assert len(found.model.modes) == len(hz)
    for mode, k in zip(found.model.modes, np.argsort(hz), strict=True):
        assert rm.mac(mode.shape, shapes[k])[0, 0] > 0.99


@pytest.fixture(scope="module")
def long_plate():
    hz, shapes = plate(0.1)
    frfs = frfs_of(hz, shapes, (8, 13), noise=1e-2)
    return frfs, rm.identify_modes(frfs, BAND_HZ)


def poles_of(found):
    return [[mode.pole for mode in each.model.modes] for each in found.references]


def test_a_pole_that_is_picked_is_fitted_to_all_forces(long_plate):
    frfs, found = long_plate
    diagram, known_hz = found.diagram, found.model.frequencies_hz
    away = np.min(np.abs(diagram.frequency_hz[:, None] / known_hz - 1), axis=1)
    inside = (diagram.frequency_hz > BAND_HZ[0]) & (diagram.frequency_hz < BAND_HZ[1])
    row = int(np.argmax(np.where(inside, away, 0.0)))
    assert away[row] > 0.02
    place = float(diagram.frequency_hz[row]), float(diagram.damping_ratio[row])
    pick = Edit(EditKind.PICK, PoleName(*place, model_order=int(diagram.model_order[row])))
    again = refit_modes(found, [pick])
    for each, before in zip(again.references, found.references, strict=True):
        chosen = [mode.chosen for mode in each.model.modes]
        assert chosen.count(Chosen.PICKED) == 1 and len(chosen) == len(known_hz) + 1
        rest = [mode for mode in each.model.modes if mode.chosen is not Chosen.PICKED]
        for mode, old in zip(rest, before.model.modes, strict=True):
            assert abs(mode.frequency_hz - old.frequency_hz) < old.frequency_std_hz
    assert poles_of(again) == poles_of(rm.identify_modes(frfs, BAND_HZ, edits=[pick]))
    assert poles_of(refit_modes(again, [])) == poles_of(found)


def test_another_start_leads_all_forces_to_the_same_modes(long_plate):
    _, found = long_plate
    mode = found.model.modes[1]
    start = Edit(EditKind.START, PoleName(1.002 * mode.frequency_hz, mode.damping_ratio))
    for new, old in zip(refit_modes(found, [start]).model.modes, found.model.modes, strict=True):
        assert abs(new.frequency_hz - old.frequency_hz) < 0.01 * old.frequency_std_hz
    with pytest.raises(InputError):
        refit_modes(found, [replace(start, kind=EditKind.LOCK)])
