"""Frozen arrays: nobody writes to them, and what is frozen already is not copied."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from ema.core.numerics import ReadonlyArrays, constant, readonly, stacked


@dataclass(frozen=True)
class Sample(ReadonlyArrays):
    label: str
    node: NDArray[np.int_]
    values: NDArray[np.complex128]


def test_arrays_of_frozen_data_have_their_declared_type_and_cannot_be_written_to():
    sample = Sample("A", [1, 2], np.ones(2))
    assert (sample.label, sample.node.dtype, sample.values.dtype) == ("A", np.int_, complex)
    assert not sample.node.flags.writeable
    assert not sample.values.flags.writeable


def test_what_can_be_written_to_is_copied():
    source = np.arange(4.0)
    window = source[:2]
    window.setflags(write=False)  # its owner can still change it
    for given in (source, window, [0.0, 1.0]):
        kept = readonly(given)
        source[0] = 7.0
        assert kept[0] == 0.0
        source[0] = 0.0
        with pytest.raises(ValueError, match="read-only"):
            kept[0] = 1.0


def test_what_is_frozen_is_kept_unless_its_type_differs():
    frozen = readonly([1.0, 2.0])
    assert readonly(frozen) is frozen
    assert readonly(frozen[1:]).base is frozen
    assert readonly(frozen, complex).dtype == complex


def test_a_constant_takes_the_memory_of_one_number():
    unknown = constant(np.nan, (300, 400))
    assert np.isnan(unknown).all()
    assert unknown.strides == (0, 0)
    assert readonly(unknown) is unknown


def test_rows_are_stacked():
    first, second = readonly(np.ones((2, 3))), readonly(np.zeros((1, 3)))
    assert stacked([first]) is first
    np.testing.assert_array_equal(stacked([first, second]), [[1] * 3, [1] * 3, [0] * 3])
    assert not stacked([first, second]).flags.writeable


@pytest.mark.parametrize(("numbers", "one"), [((np.nan, np.nan), True), ((1.0, 2.0), False)])
def test_constants_are_stacked(numbers, one):
    parts = [constant(number, (2, 3)) for number in numbers]
    found = stacked(parts)
    np.testing.assert_array_equal(found, np.concatenate(parts))
    assert (found.strides == (0, 0)) is one
