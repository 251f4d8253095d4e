"""Where ``ringmodal`` starts: quick to load, to be ready for an interrupt from the beginning."""

from __future__ import annotations

import atexit
import gc
import sys

from pipelines.cli.streams import (
    Interrupted,
    interruptible,
    make_tolerant,
    output_trouble,
    tolerant_output,
)


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


if __name__ == "__main__":
    main()
