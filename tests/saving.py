"""Saving one result after the other until killed: ``saving.py PLACE``, told by lines of input.

Imports take seconds. Each line therefore makes a copy of this process that is warm already; its
number is printed, and once more when it has ended.
"""

import os
import sys
from dataclasses import replace
from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from results import structure_result

from pipelines.report.write import save

RESULT = structure_result()


def save_again_and_again(folder):
    """Replace the result at a place by the next one until killed."""
    for number in count(1):
        save(numbered(number), folder, report=False, force=True)


def numbered(number):
    """A result whose every larger file tells its number."""
    frf = replace(RESULT.frf, values=np.full_like(RESULT.frf.values, number))
    model = replace(RESULT.modal_model, misfit=float(number))
    provenance = RESULT.provenance | {"campaign": str(number)}
    known = {"frf": frf, "measured": frf, "modal_model": model, "provenance": provenance}
    return replace(RESULT, name=str(number), **known)


def numbers(result):
    """Numbers that a result tells; a single one unless two results were mixed."""
    return {
        int(result.name),
        int(result.provenance["campaign"]),
        round(result.modal_model.misfit),
        *np.unique(result.frf.values.real).astype(int).tolist(),
    }


def main():
    with TemporaryDirectory() as scratch:  # whatever is imported on the way is there from now on
        save(numbered(0), Path(scratch) / "result", report=False)
    for _ in sys.stdin:
        child = os.fork()
        if child == 0:
            save_again_and_again(Path(sys.argv[1]))
        print(child, flush=True)  # noqa: T201
        os.waitpid(child, 0)
        print(child, flush=True)  # noqa: T201


if __name__ == "__main__":
    main()
