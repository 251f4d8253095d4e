"""Where ``ringmodal`` starts: quick to load, to be ready for an interrupt from the beginning."""

from __future__ import annotations

import sys
from typing import Any

from pipelines.cli.interrupt import Interrupted, interruptible
from pipelines.cli.streams import make_tolerant, output_trouble, tolerant_output


def main() -> None:
    """Run the command line; whatever ends it early ends with one message and its exit code.

    2 for bad input and for files (or a standard output) that cannot be read or written, 130 or 143
    when asked to stop, 1 for too little memory and for an internal error.
    """
    make_tolerant()
    tolerant_output()
    try:
        with interruptible():
            code = _run()
    except Interrupted as interrupted:
        from ema.core.errors import visible_line

        print(visible_line(f"Interrupted: {interrupted.outcome}."), file=sys.stderr)  # noqa: T201
        code = interrupted.exit_code
    trouble = output_trouble()
    if trouble is not None and not code:
        reason = f"Error: standard output: {trouble.strerror}; not all was printed, files that"
        print(f"{reason} were asked for are complete.", file=sys.stderr)  # noqa: T201
        code = 2
    sys.exit(code)


def _run() -> Any:
    """Exit code of the command; an internal error is handed on."""
    # Not above: `main` has to be ready for an interrupt before anything slow is loaded.
    from ema.core.errors import (
        FitError,
        InputError,
        file_trouble,
        is_drive_trouble,
        out_of_memory,
    )
    from model.errors import ParameterError
    from pipelines.cli import terminal
    from pipelines.cli.app import app

    terminal.show_logs()
    sys.excepthook = terminal.report_fault  # until `--debug` is read
    try:
        app()
    except SystemExit as ended:
        return ended.code
    except (InputError, FitError, ParameterError) as error:
        terminal.complain(f"Error: {error}")
        return 2
    except OSError as error:
        if not is_drive_trouble(error):
            raise
        terminal.complain(file_trouble(error))
        return 2
    except MemoryError as error:
        terminal.complain(out_of_memory(error))
        return 1
    return 0


if __name__ == "__main__":
    main()
