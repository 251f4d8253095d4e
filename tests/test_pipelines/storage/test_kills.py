"""Real kills: processes that save results again and again, ended at random moments."""

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from saving import numbered, numbers

from pipelines.report.write import save
from pipelines.results.store import load

KILLS = 30
LONGEST = 6  # times what saving takes on this machine


@pytest.fixture
def saving(tmp_path):
    """A program that starts processes to be killed."""
    tests = Path(__file__).parents[2]
    program = [sys.executable, tests / "saving.py", tmp_path / "result"]
    paths = os.pathsep.join([str(tests.parent), *sys.path])
    with subprocess.Popen(
        program,
        env={**os.environ, "PYTHONPATH": paths, "OMP_NUM_THREADS": "1"},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as running:
        yield running


@pytest.mark.skipif(not hasattr(os, "fork"), reason="the system cannot copy a process")
def test_a_killed_process_leaves_one_complete_result(saving, tmp_path):
    place, draw, found = tmp_path / "result", random.Random(1), set()
    save(numbered(0), place, report=False)
    start_s = time.perf_counter()
    save(numbered(0), place, report=False, force=True)
    longest_s = LONGEST * (time.perf_counter() - start_s)
    for _ in range(KILLS):
        print(file=saving.stdin, flush=True)
        process = int(saving.stdout.readline())
        time.sleep(draw.uniform(0.0, longest_s))
        os.kill(process, signal.SIGKILL)
        assert int(saving.stdout.readline()) == process
        told = numbers(load(place))
        assert len(told) == 1
        found |= told
    assert len(found) > 1
    save(numbered(0), place, report=False, force=True)
    assert [path.name for path in tmp_path.iterdir()] == ["result"]
