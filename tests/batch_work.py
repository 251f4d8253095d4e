"""What workers of a batch are given to do in tests; a module that new processes can import."""

import os
import signal
import sys
import time
from pathlib import Path

from pipelines.batch.state import DONE, Fingerprint, Record
from pipelines.batch.workers import ONE_THREAD
from pipelines.storage.atomic import partial_folder

DEADLY, DEADLY_ONCE = "tyre_3", "tyre_5"


def working(task):
    """Work that tells with which limits it was done, and whether with Dask."""
    threads = " ".join(os.environ.get(name, "") for name in ONE_THREAD)
    if "distributed" in sys.modules:
        threads += ", Dask"
    return Record(task.campaign.name, DONE, Fingerprint("", ()), message=threads)


def perilous(task):
    """Work of which one campaign kills the first worker that takes it, and one every worker."""
    trace = Path(f"{task.folder.path}.killed")
    if task.campaign.name == DEADLY or (task.campaign.name == DEADLY_ONCE and not trace.exists()):
        if task.campaign.name == DEADLY_ONCE:
            trace.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return working(task)


class Unloadable:
    """Work at which a worker ends before it is ready, as one does that cannot import it."""

    def __reduce__(self):
        return os._exit, (3,)


def patient(task):
    """Work that begins a result, says so, and does not end."""
    place = task.folder.result(task.campaign.place)
    place.parent.mkdir(parents=True, exist_ok=True)
    with partial_folder(place) as partial:
        (partial / str(os.getpid())).touch()
        time.sleep(600)
