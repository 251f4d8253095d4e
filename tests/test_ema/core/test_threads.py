"""Threads of linear algebra: one in small problems, as many as before when they are done."""

import threading

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from ema.core.numerics import one_blas_thread


def n_threads():
    """Threads that the linear algebra of this process may use."""
    np.linalg.norm(np.eye(2) @ np.eye(2))  # loads it
    return {each["num_threads"] for each in threadpool_info() if each["user_api"] == "blas"}


@pytest.fixture(autouse=True)
def two_threads():
    with threadpool_limits(2, user_api="blas"):
        if n_threads() != {2}:
            pytest.skip("the linear algebra here has one thread only")
        yield


def test_calls_that_overlap_have_one_thread_each_and_leave_what_was(two_threads):
    first_is_in, second_is_in, first_is_out = (threading.Event() for _ in range(3))
    seen = []

    @one_blas_thread
    def first():
        first_is_in.set()
        assert second_is_in.wait(30)
        seen.append(n_threads())

    @one_blas_thread
    def second():
        second_is_in.set()
        assert first_is_out.wait(30)
        seen.append(n_threads())

    def run_second():
        assert first_is_in.wait(30)
        second()

    other = threading.Thread(target=run_second)
    other.start()
    first()
    first_is_out.set()
    other.join()
    assert seen == [{1}, {1}]
    assert n_threads() == {2}


def test_a_call_within_a_call_or_one_that_fails_leaves_what_was():
    @one_blas_thread
    def inner():
        raise ValueError

    @one_blas_thread
    def outer():
        with pytest.raises(ValueError, match=r"^$"):
            inner()
        return n_threads()

    assert outer() == {1}
    assert n_threads() == {2}
