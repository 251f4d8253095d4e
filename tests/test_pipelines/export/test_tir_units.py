"""Values of tyre property files in SI, whatever their [UNITS]."""

import math

import pytest

from ema.core.errors import InputError
from pipelines.export.tir_file import positive_si_value, si_value, tir_of, units_of


def file(units="", rest=""):
    return tir_of(f"[UNITS]\n{units}\n[ANY]\n{rest}\n".encode(), "tyre.tir")


MM = "LENGTH = 'mm'\nFORCE = 'kN'\nMASS = 'gram'\nTIME = 'second'\nANGLE = 'degrees'"


@pytest.mark.parametrize(
    ("key", "size", "unit"),
    [
        ("UNLOADED_RADIUS", 1e-3, "mm"),
        ("BELT_MASS", 1e-3, "g"),
        ("BELT_IYY", 1e-9, "g mm²"),
        ("INFLPRES", 1e9, "kN/mm²"),
        ("ALPMAX", math.pi / 180.0, "deg"),
        ("YAW_STIFFNESS", 180.0 / math.pi, "kN mm/deg"),
        ("GRAVITY", 1e-3, "mm/s²"),
        ("FREQ_LONG", 1.0, "Hz"),
        ("DAMP_LONG", 1.0, "1"),
    ],
)
def test_units_are_honoured(key, size, unit):
    tir = file(MM, f"{key.lower()} = 2.0")
    units = units_of(tir)
    assert units.assumed == ()
    assert si_value(tir, units, key) == pytest.approx(2.0 * size)
    assert units.unit(key) == unit


def test_without_units_it_is_si():
    tir = tir_of(b"[OPERATING_CONDITIONS]\nINFLPRES = 220000\n", "tyre.tir")
    units = units_of(tir)
    assert units.assumed == ("LENGTH", "FORCE", "MASS", "TIME", "ANGLE")
    assert si_value(tir, units, "INFLPRES") == 220000.0
    assert units.unit("INFLPRES") == "Pa"
    assert units.unit("BELT_IYY") == "kg m²"


def test_a_unit_of_pressure_of_its_own():
    tir = file("LENGTH = 'mm'\nPRESSURE = 'bar'", "INFLPRES = 2.2")
    assert si_value(tir, units_of(tir), "INFLPRES") == pytest.approx(220000.0)


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("LENGTH = 'milimeter'", "tyre.tir, line 2, LENGTH: 'milimeter'; .*'millimeter'"),
        ("FORCE = 'mN'", "unknown unit of force"),
        ("ANGLE = 'gon'", "radians"),
        ("MASS = 'kg'\nMASS = 'g'", "lines 2 and 3"),
    ],
)
def test_unknown_units_are_refused(line, expected):
    with pytest.raises(InputError, match=expected):
        units_of(file(line))


def test_unknown_keys_and_useless_values_are_refused():
    tir = file("", "BELT_MASS = 0\nPCX1 = 1.6")
    units = units_of(tir)
    with pytest.raises(InputError, match="Did you mean 'BELT_MASS'"):
        si_value(tir, units, "BELTMASS")
    with pytest.raises(InputError, match=r"BELT_MASS: 0; .*in kg"):
        positive_si_value(tir, units, "BELT_MASS")
    with pytest.raises(InputError, match=r"FREQ_LONG: not given; .*in Hz"):
        positive_si_value(tir, units, "FREQ_LONG")
