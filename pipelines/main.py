"""Where ``ringmodal`` starts: quick to load, to be ready for an interrupt from the beginning."""

from __future__ import annotations

import sys

from pipelines.console_encoding import tolerant_output
from pipelines.interrupt import Interrupted, interruptible


def main() -> None:
    """Run the command line; whatever ends it early ends with one message and its exit code.

    2 for bad input and for files that cannot be read or written, 130 or 143 when asked to stop, 1
    for too little memory and for a fault of the program.
    """
    tolerant_output()
    try:
        with interruptible():
            _run()
    except Interrupted as interrupted:
        print(f"Interrupted: {interrupted.outcome}.", file=sys.stderr)  # noqa: T201
        sys.exit(interrupted.exit_code)


def _run() -> None:
    from ema.errors import FitError, InputError
    from model.errors import ParameterError
    from pipelines import console
    from pipelines.cli import app

    try:
        app()
    except (InputError, FitError, ParameterError) as error:
        console.complain(f"Error: {error}")
        sys.exit(2)
    except OSError as error:
        if error.filename is None:
            raise
        console.complain(console.file_trouble(error))
        sys.exit(2)
    except MemoryError as error:
        console.complain(console.out_of_memory(error))
        sys.exit(1)


if __name__ == "__main__":
    main()
