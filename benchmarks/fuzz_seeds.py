"""Small valid files of each format, the seeds of fuzzing: python benchmarks/fuzz_seeds.py.

They are written by the libraries that others write them with, into `fuzz_corpus/`.
"""

from __future__ import annotations

import sys
from pathlib import Path

from fuzz_formats import BESIDE, CORPUS

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "tests"))  # the builders of scenarios


def universal_files() -> dict[str, bytes]:
    """Return datasets 58 of all kinds, nodes and units."""
    import scenarios_uff as cases
    from builders import frf58, nodes15, nodes2411, units164
    from scenarios import force, sensor

    circle = {1: (0.3, 0.0, 0.0), 2: (0.0, 0.3, 0.0), 3: (-0.3, 0.0, 0.0), 4: (0.0, -0.3, 0.0)}
    more = sensor(name="A02", node=2, direction=-3)
    read = {each.name: each.files["a.uff"] for each in cases.SCENARIOS if "a.uff" in each.files}
    return {
        "binary": force() + sensor() + more,
        "big_endian": read["uff big-endian doubles"],
        "ascii": read["uff E20.12 under a single-precision header"],
        "geometry": units164(1.0, 1.0) + nodes15(circle) + force() + sensor() + more,
        "nodes_2411": nodes2411(circle) + force() + sensor(),
        "frf": frf58([1 + 1j, 2, 3, 4 - 1j]) + frf58([2, 3, 4, 5j], node=2),
    }


def tables() -> dict[str, bytes]:
    """Return tables in several dialects."""
    from scenarios import table

    text = "".join(table().splitlines(keepends=True)[:20])
    european = text.replace(",", ";").replace(".", ",")
    return {
        "plain": text.encode(),
        "european": european.encode(),
        "tabs": text.replace(",", "\t").replace("\n", "\r\n").encode(),
        "latin_1": text.replace("force", "Prüfkraft").encode("latin-1"),
    }


def main() -> None:
    import gzip

    from scenarios_campaign import MANIFEST, RUNS

    written = {
        "uff": universal_files(),
        "csv": tables(),
        "gzip": {name: gzip.compress(text, mtime=0) for name, text in tables().items()},
        "manifest": {"whole": MANIFEST.encode()},
        BESIDE: RUNS,
    }
    for kind, files in written.items():
        folder = CORPUS / kind
        folder.mkdir(parents=True, exist_ok=True)
        for name, content in files.items():
            (folder / name).write_bytes(content)


if __name__ == "__main__":
    main()
