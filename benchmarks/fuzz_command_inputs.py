"""Inputs of one case: copies of good ones, changed where it hurts."""

from __future__ import annotations

import random
import shutil
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from fuzz_command_edits import (
    ODD_TEXTS,
    changed,
    edit_csv,
    edit_file,
    edit_tir,
    hurt,
    repair_checksums,
    seal_again,
    spoiled,
    strange,
    toml_text,
)
from fuzz_command_seeds import WRITERS
from fuzz_files import CORPUS, mutate

GOOD_SHARE = 0.35
FOREIGN = (".notes.txt", "thesis.txt", ".git/HEAD")  # the user's own, in a result folder
# Tables of a manifest that the seeds leave out.
_MORE_MANIFEST: dict[str, Any] = {
    "sensors": {"mass_kg": 0.004},
    "processing": {
        "averages": 4,
        "window": "boxcar",
        "overlap": 0.0,
        "band_hz": [20.0, 260.0],
        "block_seconds": 0.5,
        "exponential_window_s": 0.5,
    },
    "excitation": {"direction": "radial", "live_mass_kg": 0.02, "channel": "A01"},
    "tuning": {"pressure_load": "dead", "radial_growth_m": {"value": 9e-4, "std": 2e-4}},
    "calibration": {"A01": {"sensitivity": "10 mV/g", "quantity": "acceleration"}},
    "tyre": {"inflation_pressure": "2.4 bar", "mean_radius": "330 mm"},
}
_FILES = (
    "",
    ".",
    "..",
    "/etc/passwd",
    "../a.uff",
    "config_2.uff",
    "pipe",
    "link.uff",
    "nowhere.uff",
    "/dev/zero",
    "campaign.toml",
    "a\u0000.uff",
    "x" * 300,
    "dangling.uff",
    "loop.uff",
    "folder",
)


class Inputs:
    """Makes inputs in a folder; what it makes is to survive the command.

    Parameters
    ----------
    seeds, folder : Path
    rng : random.Random
    """

    def __init__(self, seeds: Path, folder: Path, rng: random.Random) -> None:
        self.seeds = seeds
        self.folder = folder
        self.rng = rng
        self.foreign: list[Path] = []
        self._made: dict[str, str] = {}

    def make(self, kind: str) -> str:
        """Path of an input of this kind, relative to the folder; the same one half of the time."""
        if kind in self._made and self.rng.random() < 0.5:
            return self._made[kind]
        makers: dict[str, Callable[[], str]] = {
            "campaign": self.campaign,
            "manifest": lambda: f"{self.campaign()}/campaign.toml",
            "recording": self.recording,
            "root": self.root,
            "result": self.result,
            "set": self.parameter_set,
            "library": self.library,
            "tir": self.tir,
            "shapes": self.shapes,
            "odd": self.odd,
        }
        self._made[kind] = makers[kind]()
        return self._made[kind]

    def campaign(self, name: str = "") -> str:
        """A campaign folder, in a format drawn."""
        rng, seeds = self.rng, self.seeds / "campaigns"
        ending = (
            "uff"
            if rng.random() < 0.4
            else rng.choice(sorted(each.name for each in seeds.iterdir()))
        )
        there = Path(shutil.copytree(seeds / ending, self._new(name or "campaign")))
        if rng.random() > GOOD_SHARE:
            act = rng.choices(
                (
                    self._edit_manifest,
                    self._spoil_manifest,
                    self._spoil_recording,
                    self._resample,
                    self._misplace,
                ),
                (6, 1, 2, 3, 1),
            )[0]
            act(there)
        return self._relative(there)

    def root(self) -> str:
        """A folder of campaigns, for the batch."""
        there = self._new("root")
        there.mkdir()
        for number in range(self.rng.choice((0, 1, 1, 2))):
            self.campaign(f"{there.name}/tyre_{number}")
        return there.name

    def recording(self) -> str:
        """One recording: of a campaign, or of the readers' own seeds."""
        rng = self.rng
        if rng.random() < 0.4:
            campaign = self.folder / self.campaign()
            files = sorted(
                p for p in campaign.iterdir() if p.name.startswith("config") and p.is_file()
            )
            return self._relative(rng.choice(files)) if files else self._relative(campaign)
        kinds = [
            each
            for each in sorted(CORPUS.iterdir())
            if each.name not in ("manifest", "beside_manifest")
        ]
        kind = rng.choice(kinds)
        seeds = [path.read_bytes() for path in sorted(kind.iterdir())]
        ending = {"matlab": "mat", "hdf5": "h5", "gzip": "csv.gz"}.get(kind.name, kind.name)
        path = self._new("recording", f".{ending}")
        data = rng.choice(seeds)
        path.write_bytes(data if rng.random() < GOOD_SHARE else mutate(data, rng, seeds))
        return self._relative(path)

    def result(self) -> str:
        """A result folder, with something foreign in it now and then."""
        rng = self.rng
        source = rng.choice(sorted((self.seeds / "results").iterdir()))
        there = Path(shutil.copytree(source, self._new("result")))
        if rng.random() > GOOD_SHARE:
            for _ in range(rng.choice((1, 1, 2))):
                self._edit_result(there)
            if rng.random() < 0.5:
                repair_checksums(there)
        if rng.random() < 0.15:
            path = there / rng.choice(FOREIGN)
            path.parent.mkdir(exist_ok=True)
            path.write_text("mine")
            self.foreign.append(path)
        return self._relative(there)

    def parameter_set(self) -> str:
        """A tyre.toml."""
        rng = self.rng
        source = self.seeds / "results" / rng.choice(("tyre", "other")) / "tyre.toml"
        path = self._new("tyre", ".toml")
        path.write_bytes(source.read_bytes())
        if rng.random() > GOOD_SHARE:
            edit_file(path, rng)
            if rng.random() < 0.6:
                seal_again(path)
        return self._relative(path)

    def library(self) -> str:
        """A library of parameter sets, with a file spoiled; its checksum fits half of the time."""
        rng = self.rng
        there = Path(shutil.copytree(self.seeds / "library", self._new("library")))
        if rng.random() > GOOD_SHARE:
            path = rng.choice(sorted(each for each in there.rglob("*") if each.is_file()))
            edit_file(path, rng)
            if rng.random() < 0.6:
                seal_again(path)
        return self._relative(there)

    def tir(self) -> str:
        """A tyre property file."""
        rng = self.rng
        seeds = [(self.seeds / name).read_bytes() for name in ("tyre.tir", "mm.tir")]
        data = rng.choice(seeds)
        if rng.random() > GOOD_SHARE:
            data = rng.choice((lambda: mutate(data, rng, seeds), lambda: edit_tir(data, rng)))()
        path = self._new("tyre", ".tir")
        path.write_bytes(data)
        return self._relative(path)

    def shapes(self) -> str:
        """A universal file with shapes, a table or another result."""
        rng = self.rng
        if rng.random() < 0.3:
            return self.result()
        if rng.random() < 0.3:
            path = self._new("shapes", ".csv")
            path.write_bytes((self.seeds / "results" / "other" / "shapes.csv").read_bytes())
            if rng.random() > GOOD_SHARE:
                edit_csv(path, rng)
            return self._relative(path)
        path = self._new("shapes", rng.choice((".uff", ".unv", ".csv", ".txt")))
        data = (self.seeds / "shapes.uff").read_bytes()
        path.write_bytes(data if rng.random() < GOOD_SHARE else mutate(data, rng, [data]))
        return self._relative(path)

    def odd(self) -> str:
        """A path that is no input at all."""
        rng = self.rng
        name = rng.choice(
            ("pipe", "loop", "dangling", "folder", "empty", "nowhere", "dev", "text", "self")
        )
        path = self._new(name)
        if name == "dev":
            return rng.choice(
                ("/dev/null", "/dev/full", "/proc/self/mem", "/etc/hostname", "/proc/1/x")
            )
        if name == "text":
            return rng.choice(ODD_TEXTS).replace("\0", "") or "."
        if name == "self":
            return "."
        if name == "empty":
            path.write_bytes(b"")
        else:
            strange(path, name)
        return self._relative(path)

    def _new(self, stem: str, ending: str = "") -> Path:
        path, number = self.folder / f"{stem}{ending}", 1
        while path.exists() or path.is_symlink():
            number += 1
            path = self.folder / f"{stem}_{number}{ending}"
        return path

    def _relative(self, path: Path) -> str:
        return str(path.relative_to(self.folder))

    # What goes wrong with a campaign.

    def _edit_manifest(self, there: Path) -> None:
        rng, path = self.rng, there / "campaign.toml"
        document = tomllib.loads(path.read_text())
        if rng.random() < 0.4:
            table = rng.choice(sorted(_MORE_MANIFEST))
            key = rng.choice(sorted(_MORE_MANIFEST[table]))
            document.setdefault(table, {})[key] = _MORE_MANIFEST[table][key]
        if rng.random() < 0.2:
            run = rng.choice(document["runs"])
            run["file"] = rng.choice(_FILES)
            strange(there / "pipe", "pipe")
            strange(there / "dangling.uff", "dangling")
            strange(there / "loop.uff", "loop")
            strange(there / "folder", "folder")
            (there / "link.uff").symlink_to("/etc/passwd")
        if rng.random() < 0.9:
            document = changed(document, rng)
        if isinstance(document, dict):
            path.write_text(toml_text(document), errors="replace")

    def _spoil_manifest(self, there: Path) -> None:
        path = there / "campaign.toml"
        if self.rng.random() < 0.2:
            path.unlink()
            strange(path, self.rng.choice(("pipe", "loop", "dangling", "folder", "nowhere")))
            return
        path.write_bytes(spoiled(path.read_bytes(), self.rng))

    def _spoil_recording(self, there: Path) -> None:
        path = self._one_recording(there)
        data = path.read_bytes()
        path.write_bytes(mutate(data, self.rng, [data]))

    def _resample(self, there: Path) -> None:
        """Write a run, or all of them, again with samples that hurt."""
        rng = self.rng
        ending = self._one_recording(there).name.partition(".")[2]
        write = WRITERS.get(ending, WRITERS["uff"])
        stored = np.load(self.seeds / "signals.npz")
        paths = sorted(each for each in there.glob("config_*"))
        several = rng.random() < 0.4
        for path in paths if several else [rng.choice(paths)]:
            samples = hurt(stored[path.name.split(".")[0]].copy(), rng)
            path.write_bytes(write([str(each) for each in stored["names"]], samples))

    def _misplace(self, there: Path) -> None:
        """Lose, swap, double or replace recordings."""
        rng, path = self.rng, self._one_recording(there)
        choice = rng.randrange(4)
        if choice == 0:
            path.unlink()
        elif choice == 1:
            shutil.copy(self._one_recording(there), path.with_name("copy_" + path.name))
        elif choice == 2:
            path.unlink()
            strange(path, rng.choice(("pipe", "loop", "dangling", "folder")))
        else:
            seeds = sorted(each for each in (self.seeds / "campaigns").rglob("config_*"))
            path.write_bytes(rng.choice(seeds).read_bytes())

    def _one_recording(self, there: Path) -> Path:
        return self.rng.choice(sorted(each for each in there.glob("config_*") if each.is_file()))

    def _edit_result(self, there: Path) -> None:
        rng = self.rng
        files = sorted(
            each for each in there.iterdir() if each.is_file() and each.name != "report.html"
        )
        if not files:
            return
        weights = [3 if each.suffix in (".json", ".parquet") else 1 for each in files]
        path = rng.choices(files, weights)[0]
        choice = rng.random()
        if choice < 0.1:
            path.unlink()
            strange(path, rng.choice(("pipe", "loop", "dangling", "folder", "nowhere", "nowhere")))
        elif choice < 0.25:
            other = rng.choice(sorted((self.seeds / "results").iterdir())) / path.name
            path.write_bytes(other.read_bytes() if other.exists() else b"")
        else:
            edit_file(path, rng)
