"""Universal files whose headers say what they should not, or what one rarely sees."""

import numpy as np
from builders import binary58, dataset, floats, frf58, nodes15, row, units164
from scenarios import ACCELERATION, FORCE, N, Read, Scenario, bad_file, bad_manifest, force, sensor
from scenarios_uff import AS_WRITTEN, ASCII_FORCE, FIRST, RUN, ascii_sensor, uff

HEADERS = (
    uff("byte order 3", RUN.replace(b"b     1", b"b     3", 1), bad_file("line 2", "order 3")),
    uff(
        "floats of a VAX",
        RUN.replace(b"b     1     2", b"b     1     1", 1),
        bad_file("dataset 1, line 2", "floating-point format 1", "IEEE"),
    ),
    uff("ordinate type 7", sensor(ordinate=7), bad_file("line 9", "type 7", "2, 4, 5 or 6")),
    uff(
        "a time response of complex values",
        binary58(floats([*FORCE, *FORCE]), ordinate=5, n=N),
        bad_file("a.uff, dataset 1", "complex", "real"),
    ),
    uff("abscissa spacing 2", sensor(even=2), bad_file("dataset 1, line 9", "spacing 2")),
    uff(
        "a dataset number that is none",
        b"    -1\n    5x\n    -1\n" + RUN,
        bad_file("a.uff, dataset 1", "'    5x'", "number of the dataset"),
    ),
    uff(
        "datasets of unknown kinds around",
        dataset(999999, "what is this") + RUN + dataset(2, "?"),
        Read(first=FIRST, findings=("dataset 2, dataset 999999|999999.*2",)),
    ),
    uff(
        "text between the datasets",
        force() + b"exported by hand\n\n$ 2 channels\n" + sensor(),
        AS_WRITTEN,
    ),
    uff(
        "numbers between the datasets",
        force() + b"  1.00000E+00  2.00000E+00\n" + sensor(),
        bad_file("a.uff, dataset 2", "1.00000E", "begins with a line"),
    ),
    uff("CR LF", force(eol="\r\n") + sensor(eol="\r\n"), AS_WRITTEN),
    uff(
        "CR only",
        (ASCII_FORCE + ascii_sensor()).replace(b"\n", b"\r"),
        bad_file("a.uff, dataset 1", "begins with a line|line end"),
    ),
    uff("NUL padding behind the end", RUN + bytes(512), AS_WRITTEN),
    uff("end mark of old systems", RUN + b"\x1a", AS_WRITTEN),
    uff(
        "UTF-16",
        (ASCII_FORCE + ascii_sensor()).decode().encode("utf-16"),
        bad_file("a.uff, dataset 1", "begins with a line|UTF-16"),
    ),
    uff("a UTF-8 byte order mark", b"\xef\xbb\xbf" + RUN, AS_WRITTEN),
    uff(
        "a latin-1 name",
        force(name="Kraft Reifenlängs", node=0) + sensor(),
        Read(channels=("Kraft Reifenlängs", "A01")),
    ),
    uff(
        "a name that is markup",
        force() + sensor(name="<script>alert(1)</script>"),
        Read(channels=("force", "<script>alert(1)</script>")),
    ),
    uff(
        "a name of 200 letters",
        force() + sensor(name="x" * 200),
        Read(channels=("force", "x" * 200)),
    ),
    uff(
        "no name but a node", force() + sensor(name="NONE", node=7), Read(channels=("force", "7+Z"))
    ),
    uff("NUL in a name", force() + sensor(name="A\x0001"), Read(channels=("force", "A\x0001"))),
    uff(
        "line 9 in free columns",
        RUN.replace(
            b"         2        64         1  0.00000E+00  5.00000E-04  0.00000E+00",
            b"2 64 1 0.0 0.0005 0.0",
        ),
        AS_WRITTEN,
    ),
)

ROLES = (
    uff(
        "two forces",
        force() + force(name="F2") + sensor(),
        bad_file("a.uff", "2 forces: force, F2"),
    ),
    uff("no force", sensor() + sensor(name="A02", node=2), bad_file("a.uff", "no force among")),
    uff("no response", force(), bad_file("a.uff", "force \\(force\\)", "at least one response")),
    uff(
        "a name twice",
        force() + sensor() + sensor(node=2),
        bad_file("a.uff", "channels 2 and 3 are both called 'A01'", "unique"),
    ),
    uff(
        "a node twice",
        force() + sensor() + sensor(name="A02"),
        bad_file("a.uff", "'A01' and 'A02' are both at node 1"),
    ),
    uff(
        "different lengths",
        force() + sensor(ACCELERATION[:60]),
        bad_file("a.uff", "64 samples of 'force', 60 of 'A01'", "equally long"),
    ),
    uff(
        "different rates",
        force() + sensor(step="  2.50000E-04"),
        bad_file("a.uff", "2000 Hz of 'force', 4000 Hz of 'A01'", "one rate"),
    ),
    uff(
        "responses in volts",
        force() + sensor(axis=(12, 0, 0, "Acceleration", "V")),
        bad_file("a.uff", "A01 \\(voltage\\)", "at least one response"),
    ),
    Scenario(
        "uff node beyond the grid",
        {
            "a.uff": force() + sensor(node=5),
            "campaign.toml": b"schema = 1\ngrid.positions = 4\nruns = [{ file = 'a.uff' }]\n",
        },
        bad_manifest("no position of 'A01' \\(node 5\\) in a.uff", "0 to 4"),
    ),
    uff(
        "units of dataset 164 that are zero",
        units164(0.0, 1.0) + RUN,
        bad_file("a.uff", "units 0", "positive"),
    ),
    uff(
        "dataset 164 cut short",
        dataset(164, row("10d", 9)) + RUN,
        bad_file("a.uff", "164|end of the dataset"),
    ),
    uff(
        "words for coordinates",
        nodes15({1: (0, 0, 0)}).replace(b"0.00000E+00", b"    nowhere") + RUN,
        bad_file("a.uff", "dataset", "nowhere|15"),
    ),
)

_LINES = np.array([1 + 1j, 2, 3, 4])
FRFS = (
    uff(
        "FRFs beside time series",
        RUN + frf58(_LINES),
        Read(runs=0, findings=("time series are left out",)),
    ),
    uff("an FRF of one line", frf58(_LINES[:1]), bad_file("dataset 1, line 9", "1 lines", "two")),
    uff(
        "FRFs with a step of zero",
        frf58(_LINES, step="  0.00000E+00"),
        bad_file("dataset 1, line 9", "step 0.0", "equidistant"),
    ),
    uff(
        "FRFs of different lines",
        frf58(_LINES) + frf58(_LINES[:3], node=2),
        bad_file("a.uff, dataset 2", "3 lines", "dataset 1: 4 lines"),
    ),
    uff(
        "FRFs of pressure",
        frf58(_LINES, axis=(15, 0, 0, "Pressure", "Pa")),
        bad_file("dataset 1, line 11", "unknown over force", "acceleration"),
    ),
    uff(
        "coherence alone",
        frf58(_LINES, function_type=6),
        bad_file("a.uff", "function type 6", "no usable datasets"),
    ),
    uff(
        "FRFs of two forces and nothing in common",
        frf58(_LINES) + frf58(_LINES, node=2, reference_node=2),
        bad_file("a.uff", "2 forces", "at the same points"),
    ),
)

SCENARIOS = (*HEADERS, *ROLES, *FRFS)
