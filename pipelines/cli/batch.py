"""``ringmodal batch``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pipelines.batch.run import Batch, run_batch
from pipelines.batch.state import Record
from pipelines.batch.summary import campaign_rows
from pipelines.cli import options as opt
from pipelines.cli.screen import shown
from pipelines.cli.streams import Interrupted
from pipelines.cli.terminal import echo, print_json
from pipelines.report.template import read_template
from pipelines.results.options import Options

MACHINES = "Machines"


@opt.with_processing_options
def batch(
    root: Annotated[Path, opt.argument("ROOT", "Folder with campaigns, at any depth.")],
    out: Annotated[
        Path, opt.option("Folder for results and tables; a later run continues.", opt.FILES, "DIR")
    ],
    options: Options,
    jobs: Annotated[
        int | None, opt.option("Worker processes. Default: one per core.", MACHINES, "N", min=1)
    ] = None,
    scheduler: Annotated[
        str | None,
        opt.option(
            "Scheduler of a Dask cluster, tls://HOST:PORT, instead of --jobs. Without TLS, anyone "
            "who reaches its port can run code in its workers and in this batch.",
            MACHINES,
            "ADDRESS",
        ),
    ] = None,
    allow_unencrypted: Annotated[
        bool, opt.flag("--allow-unencrypted", "Allow a --scheduler without TLS.", MACHINES)
    ] = False,
    reports: Annotated[
        bool,
        opt.flag("--reports", "Write a report.html for each campaign; takes longer.", opt.FILES),
    ] = False,
    retry_failed: Annotated[
        bool,
        opt.flag("--retry-failed", "Retry campaigns that failed and have not changed.", opt.FILES),
    ] = False,
    template: opt.Template = None,
    units: opt.UnitSystem = None,
    as_json: opt.Json = False,
    quiet: opt.Quiet = False,
) -> None:
    """Process every campaign under a folder, and collect modes and parameters.

    A campaign that cannot be processed becomes a row with its message. The same command again
    processes only what is new or changed. Ends with code 1 if any campaign failed.

    Examples:
      ringmodal batch measurements/2025 --out results/2025
      ringmodal batch measurements --out results --jobs 4 --reports
      ringmodal batch measurements --out results --scheduler tls://node1:8786
    """  # noqa: D406, D407 - a heading of the help
    n_finished = 0
    with shown(quiet=quiet) as progress:

        def finished(record: Record, done: int, total: int) -> None:
            nonlocal n_finished
            n_finished = done
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
                template=read_template(template, units),
                retry_failed=retry_failed,
                finished=finished,
                announce=progress.line,
            )
        except Interrupted as interrupted:
            interrupted.outcome = (
                f"{n_finished} campaigns of this run are complete; the same command again "
                "processes the others"
            )
            raise
    if as_json or not quiet:
        _show(found, as_json=as_json)
    if found.failed:
        raise typer.Exit(1)


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
        print_json({"out": str(found.folder.path), **counts, "campaigns": rows})
        return
    text = f"{counts['done']} done, {counts['failed']} failed (see {found.folder.summary})"
    text += f", {counts['already_done']} already done"
    if counts["failed_before"]:
        text += f", {counts['failed_before']} failed before (use --retry-failed to retry them)"
    echo(text if counts["done"] or counts["failed"] else f"Nothing to do: {text}")
