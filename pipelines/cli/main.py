"""Where ``ringmodal`` starts: quick to load, to be ready for an interrupt from the beginning."""

from __future__ import annotations

import atexit
import ctypes
import gc
import sys
from contextlib import suppress

from pipelines.cli.streams import (
    Interrupted,
    interruptible,
    make_tolerant,
    output_trouble,
    tolerant_output,
)

# Of mallopt: what is larger comes from the system each time, and what is freed beyond goes back.
_MMAP_THRESHOLD, _TRIM_THRESHOLD = (-3, 1 << 25), (-1, 1 << 28)


def main() -> None:
    """Run the command line and exit with its code.

    The code is 2 for bad input and for files (or a standard output) that cannot be read or written,
    130 or 143 after an interrupt or termination, 1 for too little memory and an internal error.
    """
    make_tolerant()
    tolerant_output()
    # Nothing that is loaded is garbage, and the search for it takes a third of start and end.
    gc.disable()
    atexit.register(gc.freeze)
    _keep_freed_memory()
    try:
        with interruptible():
            # Not above: `main` must be ready for an interrupt before anything slow is loaded.
            from pipelines.cli.app import run

            code = run()
    except Interrupted as interrupted:  # while loading; later ones are handled in `run`
        print(f"Interrupted: {interrupted.outcome}.", file=sys.stderr)  # noqa: T201
        code = interrupted.exit_code
    finally:
        gc.enable()
    trouble = output_trouble()
    if trouble is not None and not code:
        reason = f"Error: standard output: {trouble.strerror}; output is incomplete."
        print(f"{reason} Files that were requested are complete.", file=sys.stderr)  # noqa: T201
        code = 2
    sys.exit(code)


def _keep_freed_memory() -> None:
    """Let the C library of Linux use freed memory again; fresh pages take longer than most sums."""
    with suppress(AttributeError, OSError, TypeError):  # other systems do so, or cannot be told
        allocate = ctypes.CDLL(None).mallopt
        for option, n_bytes in (_MMAP_THRESHOLD, _TRIM_THRESHOLD):
            allocate(option, n_bytes)


if __name__ == "__main__":
    main()
