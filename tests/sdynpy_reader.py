"""Universal files as SDynPy reads them, in a Python that has it."""

import importlib.util
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest


def read_by_sdynpy(path):
    """What SDynPy makes of a file; skips the test where there is none.

    RINGMODAL_SDYNPY names a Python that has it, else it is this one.
    """
    other = os.environ.get("RINGMODAL_SDYNPY")
    if not other and importlib.util.find_spec("sdynpy") is None:
        pytest.skip("no SDynPy: name a Python that has it in RINGMODAL_SDYNPY")
    answer = subprocess.run(
        [other or sys.executable, Path(__file__).with_name("second_reader.py"), path],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "QT_QPA_PLATFORM": "offscreen", "PYTHONPATH": ""},
    )
    return json.loads(answer.stdout.splitlines()[-1])
