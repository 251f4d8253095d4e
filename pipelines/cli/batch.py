"""The command line's ``ringmodal batch``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipelines.batch.run import run_batch
from pipelines.batch.tables import campaign_rows
from pipelines.cli import terminal
from pipelines.cli.interrupt import Interrupted
from pipelines.cli.options import FILES, Json, Quiet, with_processing_options
from pipelines.cli.progress import shown

if TYPE_CHECKING:
    from pipelines.batch.run import Batch
    from pipelines.batch.state import Record
    from pipelines.results.options import Options

MACHINES = "Machines"


@with_processing_options
def batch(
    root: Annotated[
        Path, typer.Argument(metavar="ROOT", help="Folder with campaigns, at any depth.")
    ],
    out: Annotated[
        Path,
        typer.Option(
            "--out",
            metavar="DIR",
            rich_help_panel=FILES,
            help="Folder for results, tables and summary; taken up again.",
        ),
    ],
    options: Options,
    jobs: Annotated[
        int | None,
        typer.Option(
            min=1,
            metavar="N",
            rich_help_panel=MACHINES,
            help="Worker processes on this machine. Default: one per core.",
        ),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            rich_help_panel=MACHINES,
            help="Scheduler of a Dask cluster, tls://HOST:PORT, instead of --jobs. "
            "Without TLS, whoever reaches its port can run code in its workers and in this batch.",
        ),
    ] = None,
    allow_unencrypted: Annotated[
        bool,
        typer.Option(
            "--allow-unencrypted",
            rich_help_panel=MACHINES,
            help="Use a --scheduler without TLS all the same.",
        ),
    ] = False,
    reports: Annotated[
        bool,
        typer.Option(
            "--reports",
            rich_help_panel=FILES,
            help="Write a report.html for each campaign; takes longer.",
        ),
    ] = False,
    retry_failed: Annotated[
        bool,
        typer.Option(
            "--retry-failed",
            rich_help_panel=FILES,
            help="Try again what failed and has not changed.",
        ),
    ] = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Process every campaign under a folder, each by itself, and gather modes and parameters.

    A campaign that cannot be processed becomes a row with its message. The same command again does
    only what is new or changed. Ends with code 0 when every campaign has its row; with --strict,
    with 2 if any failed.

    Examples:
      ringmodal batch measurements/2025 --out results/2025
      ringmodal batch measurements --out results --jobs 4 --reports
      ringmodal batch measurements --out results --scheduler tls://node1:8786
    """  # noqa: D406, D407 - a heading of the help
    finished = 0
    with shown(quiet=quiet) as progress:

        def told(record: Record, done: int, total: int) -> None:
            nonlocal finished
            finished = done
            progress.step(done, total)
            progress.line(_outcome(record))

        progress.stage("Processing campaigns …")
        try:
            found = run_batch(
                root,
                out,
                options,
                jobs=jobs,
                scheduler=scheduler,
                allow_unencrypted=allow_unencrypted,
                reports=reports,
                retry_failed=retry_failed,
                finished=told,
                say=progress.line,
            )
        except Interrupted as interrupted:
            interrupted.outcome = (
                f"{finished} campaigns of this run stand; the same command again does the others"
            )
            raise
    _show(found, as_json=as_json)
    if options.strict and found.failed:
        raise typer.Exit(2)


def _outcome(record: Record) -> str:
    if not record.is_done:
        return f"{record.campaign}: failed. {record.message}"
    warnings = f", {record.n_warnings} warnings" if record.n_warnings else ""
    return f"{record.campaign}: {len(record.modes)} modes{warnings}, {record.seconds:.1f} s"


def _show(found: Batch, *, as_json: bool) -> None:
    counts = {
        "done": found.count(done=True, fresh=True),
        "failed": found.count(done=False, fresh=True),
        "already_done": found.count(done=True, fresh=False),
        "failed_before": found.count(done=False, fresh=False),
    }
    if as_json:
        rows = campaign_rows(found.records)
        terminal.print_json({"out": str(found.folder.path), **counts, "campaigns": rows})
        return
    terminal.say(_summary(counts, found.folder.summary))


def _summary(counts: dict[str, int], page: Path) -> str:
    text = f"{counts['done']} done, {counts['failed']} failed (see {page})"
    text += f", {counts['already_done']} already done"
    if counts["failed_before"]:
        text += f", {counts['failed_before']} failed before (--retry-failed tries them again)"
    return text if counts["done"] or counts["failed"] else f"Nothing to do: {text}"
