"""What Arrow reads is its own: its threads never need Python to let go of it."""

import sys

import pytest

from ema.io.content import arrow_reader


@pytest.mark.parametrize("content", [b"", b"1.0,2.0\n" * 1000])
def test_arrow_reads_a_copy_and_keeps_nothing_of_pythons(content):
    before = sys.getrefcount(content)
    reader = arrow_reader(content)
    assert sys.getrefcount(content) == before
    assert reader.read() == content
