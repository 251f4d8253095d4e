"""Command lines over all commands and options, taken from the program as it is."""

from __future__ import annotations

import random
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, get_args

import typer
from fuzz_command_edits import BAD_NUMBERS, ODD_TEXTS
from fuzz_command_inputs import Inputs

from model.tuning_problem import PARAMETERS
from pipelines.cli.app import app

# Commands that do not end by themselves, and options that change the shell of whoever runs this.
_NEVER = frozenset({"review", "--install-completion"})
_WEIGHTS = {  # how often, against 10; slow commands whose only input are options come up less
    "process": 40,
    "inspect": 25,
    "init": 15,
    "tune": 25,
    "report": 14,
    "compare": 18,
    "export": 18,
    "compare-shapes": 18,
    "batch": 1,
    "paper": 0.3,
    "demo": 0.5,
    "doctor": 0.5,
}
# Two lines of three are typed with care, to reach what lies behind the checks of options.
_SHARE_CAREFUL = 0.65
_GOOD_VALUES = {True: 0.98, False: 0.5}
# What an argument or option takes: by its name, of a command or of all.
_KINDS = {
    ("process", "campaign"): ("campaign",) * 6 + ("manifest", "recording", "recording"),
    ("inspect", "files"): ("recording",) * 4 + ("campaign", "manifest"),
    ("init", "folder"): ("campaign",),
    ("batch", "root"): ("root",),
    ("tyre add", "result"): ("result", "result", "set"),
    ("tyre update-tir", "file"): ("tir",),
    ("tyre from-tir", "file"): ("tir",),
    "result_folder": ("result",),
    "result": ("result",),
    "first": ("result",),
    "second": ("result",),
    "other": ("shapes",),
    "tyre": ("set", "set", "result"),
    "source": ("set", "result", "name"),
    "from": ("set", "result", "name"),
    "like": ("set", "result", "name"),
    "library": ("library",),
    "name": ("name",),
    "names": ("name",),
    "edits": ("odd",),
}
_NAMES = (
    "225-55R17",
    "225-55R17@1",
    "225-55R17@2",
    "225/55R17",
    "225-55R17_winter",
    "225-55R17@9",
    "225-55R17@0",
    "225-55R17@-1",
    "225-55R17@x",
    "@1",
    "225-55R17@1@2",
    "../225-55R17",
    "",
)
_CONDITIONS = ("temperature_c", "load_n")
_OUTPUTS = {
    "folder": ("out", "out", "out", "out/deep/er", "out "),
    ".csv": ("t.csv", "t.parquet", "t.CSV", "t.txt", "t"),
    ".png": ("f.png", "f.svg", "f.pdf", "f"),
    ".html": ("c.html", "c.htm", "c"),
    "any": (
        "o.uff",
        "o.csv",
        "o.json",
        "o.mat",
        "o.html",
        "o.tir",
        "o.toml",
        "o.xml",
        "o.dat",
        "o",
    ),
}
_TEXT_POOLS = {
    "window": (
        "hann",
        "boxcar",
        "flattop",
        "tukey",
        "kaiser",
        "('kaiser', 8)",
        "gaussian",
        "dpss",
        "HANN",
    ),
    "estimator": ("H1", "H2", "Hv", "hv", "H3"),
    "method": ("lsce", "plscf", "LSCE", "x"),
    "objective": ("frequency", "paper", "x"),
    "file_format": ("uff", "csv", "json", "mat", "simpack", "adams", "x"),
    "frfs": ("both", "measured", "synthesised", "none", "x"),
    "by": ("angle", "node", "x"),
    "direction": ("radial", "x", "y", "z", "w"),
    "reference": ("REF", "A01", "force", "x"),
    "scheduler": ("tcp://127.0.0.1:9", "x", "tcp://", "http://127.0.0.1:1"),
    "export_format": ("toml", "json", "csv", "adams", "cdtire", "ftire", "x"),
}


@dataclass
class Line:
    """A command line, and what it may write to.

    Attributes
    ----------
    command : str
        As in ``tyre add``.
    arguments : list of str
    outputs : list of str
        Paths that the command was given to write to.
    """

    command: str
    arguments: list[str] = field(default_factory=list)
    outputs: list[str] = field(default_factory=list)

    @property
    def may_replace(self) -> bool:
        """Whether it was told to replace what is there."""
        return "--force" in self.arguments


def commands() -> dict[str, list[Any]]:
    """Every command that ends by itself, with its parameters."""
    found: dict[str, list[Any]] = {}

    def walk(command: Any, path: tuple[str, ...]) -> None:
        for name in command.list_commands(None):
            if name in _NEVER:
                continue
            inner = command.get_command(None, name)
            if hasattr(inner, "list_commands"):
                walk(inner, (*path, name))
            else:
                found[" ".join((*path, name))] = inner.params

    walk(typer.main.get_command(app), ())
    return found


class Lines:
    """Draws command lines."""

    def __init__(self) -> None:
        self.commands = commands()

    def draw(self, rng: random.Random, inputs: Inputs) -> Line:
        """A command line; its inputs are made as they are named."""
        names = sorted(self.commands)
        command = rng.choices(names, [_WEIGHTS.get(name, 10.0) for name in names])[0]
        drawing = _Drawing(Line(command), rng, inputs)
        if rng.random() < 0.03:
            drawing.line.arguments.append(
                rng.choice(("--debug", "--version", "--help", "--nonsense", "x"))
            )
        drawing.line.arguments += command.split()
        params = self.commands[command]
        arguments = [p for p in params if p.param_type_name == "argument"]
        options = [p for p in params if p.param_type_name != "argument"]
        parts = [drawing.argument(param) for param in arguments]
        share = rng.choice((0.0, 0.1, 0.2, 0.4))
        for param in options:
            wanted = 0.97 if param.required or param.name == "library" else share
            if drawing.careful and param.name == "scheduler":
                wanted = 0.0
            if param.name == "pdf":
                wanted *= 0.3  # typesetting takes ten times as long as all the rest
            if param.name in ("force", "as_json", "accept_changes"):
                wanted = 0.4
            for _ in range(
                rng.choice((1, 2, 3)) if param.multiple and rng.random() < wanted else 1
            ):
                if rng.random() < wanted:
                    parts.append(drawing.option(param))
        if rng.random() < 0.5:
            rng.shuffle(parts)
        drawing.line.arguments += [text for part in parts for text in part]
        _slip(drawing.line.arguments, rng)
        return drawing.line


def _slip(arguments: list[str], rng: random.Random) -> None:
    """A slip of the hand, now and then."""
    if rng.random() > 0.06 or len(arguments) < 2:
        return
    at = rng.randrange(1, len(arguments))
    choice = rng.randrange(5)
    if choice == 0:
        del arguments[at]
    elif choice == 1:
        arguments.insert(at, rng.choice(ODD_TEXTS).replace("\0", ""))
    elif choice == 2:
        arguments[at] = arguments[at][:-1]
    elif choice == 3:
        arguments.insert(at, arguments[at])
    else:
        arguments.insert(at, rng.choice(("--help", "--", "-h", "--forec", "--out", "--json")))


class _Drawing:
    """Values of the parameters of one line."""

    def __init__(self, line: Line, rng: random.Random, inputs: Inputs) -> None:
        self.line = line
        self.rng = rng
        self.inputs = inputs
        self.careful = rng.random() < _SHARE_CAREFUL

    def _is_good(self) -> bool:
        return self.rng.random() < _GOOD_VALUES[self.careful]

    def argument(self, param: Any) -> list[str]:
        n = self.rng.choice((1, 1, 1, 2, 3)) if param.nargs == -1 else 1
        if self.careful and self.line.command == "process":
            n = 1  # several are recordings, which seldom make a campaign
        if param.nargs == -1 and not param.required and self.rng.random() < 0.5:
            n = 0
        return [self._value(param) for _ in range(n)]

    def option(self, param: Any) -> list[str]:
        name = self.rng.choice([*param.opts, *param.secondary_opts])
        if param.is_flag:
            return [name]
        values = [self._value(param) for _ in range(param.nargs)]
        if self.careful and param.nargs == 2:
            values = self.rng.choice((["20", "260"], ["40", "200"], ["60", "900"]))
        if param.nargs == 1 and self.rng.random() < 0.2:
            return [f"{name}={values[0]}"]
        return [name, *values]

    def _value(self, param: Any) -> str:
        rng = self.rng
        if not self.careful and rng.random() < 0.05:
            return rng.choice(ODD_TEXTS).replace("\0", "")
        if param.metavar and "FROM:TO" in param.metavar:
            return self._range(str(param.default or "0:10:1"), param.metavar.count(":") + 1)
        if param.metavar == "NAME=VALUE":
            return self._named_value()
        if param.metavar == "HZ,HZ,…":
            return ",".join(self._number(100.0) for _ in range(rng.choice((1, 2, 7))))
        kinds = set(_types(param.type_descriptor.annotation))
        known = [str(each) for each in param.type_descriptor.choices or ()]
        if known:
            return (
                rng.choice(known)
                if rng.random() < 0.9
                else rng.choice((*known, "x", "", known[0].upper()))
            )
        if int in kinds or float in kinds:
            return self._number(param.default, whole=int in kinds, least=param.min, most=param.max)
        return self._path_or_text(param, is_path=Path in kinds)

    def _path_or_text(self, param: Any, *, is_path: bool) -> str:
        rng = self.rng
        kinds = _KINDS.get((self.line.command, param.name)) or _KINDS.get(param.name)
        if param.name == "source" and param.opts == ["--from"]:
            kinds = _KINDS["from"]
        if param.name in ("note", "author") or (param.name == "tyre_id"):
            return rng.choice((*ODD_TEXTS, "winter", "me")).replace("\0", "")
        if kinds is None and is_path:
            return self._output(param)
        if kinds is None:
            pool = "export_format" if self.line.command == "tyre export" else param.name
            texts = _TEXT_POOLS.get(pool, ODD_TEXTS)
            known = texts[: (len(texts) + 1) // 2] if self.careful else texts
            return rng.choice(known).replace("\0", "")
        kind = "odd" if not self.careful and rng.random() < 0.1 else rng.choice(kinds)
        if kind == "name":
            return rng.choice(_NAMES[:4] if self._is_good() else _NAMES)
        made = self.inputs.make(kind)
        return (
            made
            if self.careful or rng.random() < 0.9
            else rng.choice((f"{made}/", f"./{made}", f"{made}x", f"{made}/x"))
        )

    def _output(self, param: Any) -> str:
        rng = self.rng
        panel = "any"
        if param.name in ("out", "folder", "figures"):
            panel = "folder" if param.metavar == "DIR" else "any"
        if self.line.command.startswith("simulate ") and param.name in ("out", "spectrum"):
            panel = ".csv"
        if param.name == "figure":
            panel = ".png"
        if self.line.command == "compare":
            panel = ".html"
        choice = rng.random()
        if self.careful:
            path = "pictures" if param.name == "figures" else _OUTPUTS[panel][0]
        elif choice < 0.5:
            path = rng.choice(_OUTPUTS[panel])
        elif choice < 0.7:
            path = rng.choice(
                ("/proc/ringmodal/x.csv", "/dev/full", "missing/x.html", "/dev/null", "x\ny.csv")
            )
        elif choice < 0.9:
            path = self.inputs.make(rng.choice(("campaign", "result", "odd", "recording")))
        else:
            path = rng.choice(ODD_TEXTS).replace("\0", "")
        self.line.outputs.append(path)
        return path

    def _number(
        self, default: Any, *, whole: bool = False, least: Any = None, most: Any = None
    ) -> str:
        rng = self.rng
        if not self._is_good():
            return rng.choice(BAD_NUMBERS)
        start = float(default) if isinstance(default, int | float) and default else 10.0
        value = start * rng.choice((0.25, 0.5, 0.8, 1.0, 1.0, 1.3, 2.0))
        value = min(
            max(value, least if least is not None else value), most if most is not None else value
        )
        return str(round(value)) if whole else f"{value:.6g}"

    def _range(self, default: str, n_parts: int) -> str:
        rng = self.rng
        if self._is_good():
            return rng.choice((default, default, "1:3", "5", "0:2:0.5"))
        parts = [rng.choice(BAD_NUMBERS) for _ in range(rng.choice((1, 2, n_parts, n_parts, 4)))]
        return ":".join(parts)

    def _named_value(self) -> str:

        rng = self.rng
        if self.careful:
            name = rng.choice(_CONDITIONS if self.line.command == "tyre add" else PARAMETERS)
            return f"{name}={self._number(20.0)}"
        name = rng.choice((*PARAMETERS, *PARAMETERS, *_CONDITIONS, "x", "é", ""))
        return f"{name}{rng.choice(('=', '=', '=', '=', '', '==', ' = '))}{self._number(20.0)}"


def _types(annotation: Any) -> list[Any]:
    """All types that an annotation names."""
    inner = get_args(annotation)
    return [found for each in inner for found in _types(each)] if inner else [annotation]
