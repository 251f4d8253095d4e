"""A server under test: a desk, a client that asks as its pages do, and a real process."""

from __future__ import annotations

import re
import shutil
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

from starlette.testclient import TestClient

from pipelines.review.answers import Office
from pipelines.review.server import application, begun

PORT, TOKEN = 8123, "f" * 64
ORIGIN = f"http://127.0.0.1:{PORT}"
PATIENCE_S = 120.0  # a busy machine is slow, not wrong


class Page:
    """What a page of the server can do."""

    def __init__(self, desk, name, **headers):
        own = {"Origin": ORIGIN, "X-Ringmodal-Token": TOKEN, **headers}
        app = application(begun(lambda: desk), PORT, TOKEN)
        self.client = TestClient(app, base_url=ORIGIN, headers=own)
        self.place = f"/api/r/{name}"

    def get(self, what, **query):
        return self.client.get(f"{self.place}/{what}", params=query)

    def post(self, what, **content):
        return self.client.post(f"{self.place}/{what}", json=content)

    def state(self):
        return self.get("state").json()

    def settled(self, *stages):
        """The state once it is final, or of another stage."""
        return until(self.state, lambda state: state["stage"] in (stages or ("final", "failed")))

    def edit(self, **edit):
        return self.post("edit", revision=self.state()["revision"], edit=edit)

    def listed(self):
        return [mode for mode in self.settled()["modes"] if mode["listed"]]


def until(ask, is_enough):
    ends = time.monotonic() + PATIENCE_S
    while not is_enough(answer := ask()):
        assert time.monotonic() < ends, answer
        time.sleep(0.02)
    return answer


@contextmanager
def review(folder, **headers):
    """A page of a result, whose server ends afterwards."""
    desk = Office(folder.parent)
    try:
        yield Page(desk, desk.name_of(folder.resolve()), **headers)
    finally:
        desk.close()


def copied(folder, place):
    """A result of one's own."""
    return Path(shutil.copytree(folder, place / "result"))


@contextmanager
def served(place, *options):
    """The command as a process; yields it, its address and the redirect file."""
    command = [sys.executable, "-m", "ringmodal", "review", str(place), "--no-open", *options]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        address = process.stdout.readline().strip()
        file = Path(process.stdout.readline().strip().removeprefix("open: "))
        yield process, address, file
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
            process.wait(PATIENCE_S)
        process.stdout.close()
        process.stderr.close()


def token_in(file):
    return re.search(r"#token=([0-9a-f]{64})", file.read_text())[1]
