"""The command line's ``ringmodal simulate``."""

from __future__ import annotations

import typer

simulate = typer.Typer(help="The ring model at work: virtual measurements.", no_args_is_help=True)


@simulate.callback()
def _group() -> None:
    """Keep the commands below the group, however few they are."""
