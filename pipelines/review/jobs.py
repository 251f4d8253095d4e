"""Campaigns processed from the landing page: `ringmodal process` as a process of its own."""

from __future__ import annotations

import subprocess
import sys
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from ema.core.errors import InputError

_RESULT = "result"  # name of the result folder in a campaign's


class Jobs:
    """Processes that were started here.

    Parameters
    ----------
    changed : callable
        Called from any thread when one of them says something or ends.
    """

    def __init__(self, changed: Callable[[], None]) -> None:
        self._changed = changed
        self._lock = threading.Lock()
        self._running: dict[Path, subprocess.Popen[str]] = {}
        self._told: dict[Path, dict[str, Any]] = {}

    @property
    def told(self) -> Mapping[Path, Mapping[str, Any]]:
        """What is known of each campaign's job."""
        with self._lock:
            return {path: dict(job) for path, job in self._told.items()}

    def start(self, campaign: Path) -> None:
        """Process a campaign into a folder inside it; `InputError` where that is impossible."""
        target = campaign / _RESULT
        with self._lock:
            if campaign in self._running:
                rule, remedy = "a campaign is processed once at a time", "Wait for its end"
                raise InputError(campaign.name, "being processed", rule, remedy)
            if target.exists():
                rule, remedy = "nothing is replaced", f"Move {target.name} away"
                raise InputError(str(target), "it exists already", rule, remedy)
            command = [sys.executable, "-m", "ringmodal", "process", str(campaign)]
            process = subprocess.Popen(
                [*command, "--out", str(target)],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                encoding="utf-8",
                errors="replace",
            )
            self._running[campaign] = process
            self._told[campaign] = {"state": "running", "text": "Starting …"}
        threading.Thread(target=self._follow, args=(campaign, process), daemon=True).start()
        self._changed()

    def close(self) -> None:
        """End all; a process that is ended leaves no half-written result."""
        with self._lock:
            running = list(self._running.values())
        for process in running:
            process.terminate()
            process.wait()

    def _follow(self, campaign: Path, process: subprocess.Popen[str]) -> None:
        assert process.stderr is not None
        last = ""
        with process.stderr as lines:
            for line in lines:
                last = line.strip() or last
                self._tell(campaign, "running", last)
        code = process.wait()
        with self._lock:
            del self._running[campaign]
        self._tell(campaign, "failed" if code else "done", last)

    def _tell(self, campaign: Path, state: str, text: str) -> None:
        with self._lock:
            self._told[campaign] = {"state": state, "text": text}
        self._changed()
