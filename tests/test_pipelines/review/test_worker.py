"""The thread of all fits: the newest edit first, the rest when nobody waits."""

import threading

import pytest

from ema.core.errors import SupersededError
from pipelines.review.worker import Worker


class Steps:
    """Work whose steps wait until they are told to end, or are stopped."""

    def __init__(self, n_steps, *, urgent=True):
        self.left, self.urgent = n_steps, urgent
        self.done, self.errors, self.stopped = [], [], 0
        self.began, self.may_end = threading.Event(), threading.Event()
        self.ended = threading.Event()

    def is_urgent(self):
        return self.urgent

    def step(self, stop):
        if self.left == 0:
            self.ended.set()
            return False
        self.began.set()
        while not self.may_end.wait(0.005):
            if stop():
                self.stopped += 1
                raise SupersededError("no longer wanted")
        self.left -= 1
        self.done.append(threading.current_thread().name)
        return True

    def failed(self, error):
        self.errors.append(error)
        self.left = 0


@pytest.fixture
def worker():
    worker = Worker()
    yield worker
    worker.end()


def test_what_is_asked_for_anew_stops_what_runs(worker):
    work = Steps(1)
    worker.wake(work)
    assert work.began.wait(5)
    for expected in range(1, 20):
        work.began.clear()
        worker.wake(work)
        assert work.began.wait(5)
        assert work.stopped == expected
    work.may_end.set()
    assert work.ended.wait(5)
    assert work.done == ["fits"]


def test_urgent_work_goes_before_what_nobody_waits_for(worker):
    final, live = Steps(1, urgent=False), Steps(1)
    live.may_end.set()
    worker.wake(final)
    assert final.began.wait(5)
    worker.wake(live)
    assert live.ended.wait(5)
    assert final.stopped == 1
    final.may_end.set()
    assert final.ended.wait(5)


def test_urgent_work_is_not_stopped_by_other_work(worker):
    first, second = Steps(1), Steps(1)
    second.may_end.set()
    worker.wake(first)
    assert first.began.wait(5)
    worker.wake(second)
    first.may_end.set()
    assert first.ended.wait(5)
    assert second.ended.wait(5)
    assert first.stopped == 0


def test_calls_come_before_what_nobody_waits_for(worker):
    final = Steps(1, urgent=False)
    worker.wake(final)
    assert final.began.wait(5)
    assert worker.call(lambda stop: threading.current_thread().name).result(5) == "fits"
    assert final.stopped >= 1
    final.may_end.set()
    assert final.ended.wait(5)


def test_errors_reach_those_who_wait(worker):
    with pytest.raises(ZeroDivisionError):
        worker.call(lambda stop: 1 / 0).result(5)
    work = Steps(1)
    work.may_end = None  # an error in a step
    worker.wake(work)
    assert work.ended.wait(5)
    assert isinstance(work.errors[0], AttributeError)
    assert worker.call(lambda stop: "still there").result(5) == "still there"
