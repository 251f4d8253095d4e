"""Manifests and folders as they should not be, or as one rarely sees them."""

from scenarios import (
    ACCELERATION,
    FORCE,
    Folder,
    Link,
    Read,
    Scenario,
    bad_file,
    bad_manifest,
    force,
    sensor,
    unusable,
)

MANIFEST = """\
schema = 1

[tyre]
designation = "225/55R17"
inflation_pressure_pa = 220000.0

[acquisition]
sampling_rate_hz = 2000.0

[grid]
positions = 4

[excitation]
channel = "force"
position_deg = 0.0

[processing]
averages = 4

[[runs]]
file = "a.uff"
reference = "REF"
positions_deg = { A01 = 0.0, REF = 2.5 }

[[runs]]
file = "b.uff"
reference = "REF"
positions_deg = { A01 = 90.0, REF = 2.5 }
"""
_RUN = force() + sensor() + sensor(ACCELERATION[::-1], name="REF", node=40)
_TURNED = force(FORCE[::-1]) + sensor() + sensor(name="REF", node=40)
RUNS = {"a.uff": _RUN, "b.uff": _TURNED}
_AS_WRITTEN = Read(
    runs=2,
    channels=("force", "A01", "REF"),
    first={"A01": tuple(ACCELERATION[:4])},
    findings=("2 of 4 grid positions not measured: 180, 270 degrees",),
    frf=2,
)


def _changed(name, old, new, expected, pending="", more=None):
    assert old in MANIFEST
    text = MANIFEST.replace(old, new, 1).encode()
    files = {**RUNS, "campaign.toml": text, **(more or {})}
    return Scenario(f"manifest {name}", files, expected, pending=pending)


def _whole(name, content, expected):
    return Scenario(f"manifest {name}", {**RUNS, "campaign.toml": content}, expected)


WRITING = (
    _whole("as it should be", MANIFEST.encode(), _AS_WRITTEN),
    _whole("CR LF", MANIFEST.replace("\n", "\r\n").encode(), _AS_WRITTEN),
    _whole("a byte order mark", MANIFEST.encode("utf-8-sig"), _AS_WRITTEN),
    _whole("UTF-16", MANIFEST.encode("utf-16"), bad_manifest("campaign.toml", "UTF-8")),
    _whole("latin-1", MANIFEST.replace("R17", "ü").encode("latin-1"), bad_manifest("UTF-8")),
    _whole("empty", b"", bad_manifest("campaign.toml, schema", "nothing", "required")),
    _whole("zeros", bytes(100), bad_manifest("campaign.toml", "TOML")),
    _whole(
        "cut short",
        MANIFEST.encode()[:-20],
        bad_manifest("campaign.toml", "end of doc|line 2", "TOML"),
    ),
    _whole("JSON", b'{"schema": 1}', bad_manifest("campaign.toml", "line 1", "TOML")),
    _whole("a key twice", b"schema = 1\nschema = 1\n", bad_manifest("TOML", "line 2|schema")),
    _whole(
        "nested a hundred thousand deep",
        b"schema = " + b"[" * 100_000,
        bad_manifest("campaign.toml", "TOML"),
    ),
    _whole(
        "dotted a thousand deep",
        b"schema = 1\n" + b".".join([b"a"] * 1000) + b" = 1\n",
        bad_manifest("campaign.toml"),
    ),
    _whole(
        "a number of a hundred thousand digits",
        MANIFEST.replace("positions = 4", "positions = 1" + "0" * 100_000).encode(),
        bad_manifest("campaign.toml"),
    ),
    _changed(
        "no runs",
        MANIFEST[MANIFEST.index("[[runs]]") :],
        "",
        bad_manifest("campaign.toml, runs", "required"),
    ),
    _changed("runs that are one table", "[[runs]]", "[runs]", bad_manifest("campaign.toml")),
)

VALUES = (
    _changed("schema 2", "schema = 1", "schema = 2", bad_manifest("campaign.toml, schema", "2")),
    _changed("schema true", "schema = 1", "schema = true", bad_manifest("toml, schema", "True")),
    _changed(
        "unknown key",
        "averages",
        "avarages",
        bad_manifest("processing.avarages", "not known", "Did you mean 'averages'"),
    ),
    _changed(
        "unknown table",
        "[grid]",
        "[gird]\nx = 1\n[grid]",
        bad_manifest("'gird'", "Did you mean 'grid'"),
    ),
    _changed(
        "text for a number",
        "220000.0",
        '"2.2 bar"',
        bad_manifest("tyre.inflation_pressure_pa", "2.2 bar", "number"),
    ),
    _changed(
        "a date for a number",
        "220000.0",
        "2026-03-04",
        bad_manifest("tyre.inflation_pressure_pa", "number"),
    ),
    _changed(
        "true for a number",
        "220000.0",
        "true",
        bad_manifest("tyre.inflation_pressure_pa", "True", "number"),
    ),
    _changed(
        "a rate that is not finite",
        "2000.0",
        "inf",
        bad_manifest("acquisition.sampling_rate_hz", "inf", "finite"),
    ),
    _changed(
        "a rate of zero",
        "2000.0",
        "0.0",
        bad_manifest("acquisition.sampling_rate_hz", "greater than 0"),
    ),
    _changed(
        "another rate than the files'",
        "2000.0",
        "2048.0",
        bad_manifest("acquisition.sampling_rate_hz", "2048 Hz", "a.uff was sampled at 2000 Hz"),
    ),
    _changed(
        "an angle that is not finite",
        "A01 = 0.0",
        "A01 = nan",
        bad_manifest("runs.1.positions_deg.A01", "nan", "finite"),
    ),
    _changed(
        "a grid of 10^18 positions",
        "positions = 4",
        "positions = 1000000000000000000",
        bad_manifest("grid.positions", "100000"),
    ),
    _changed(
        "a thousand million averages",
        "averages = 4",
        "averages = 1000000000",
        Read(
            runs=2,
            channels=_AS_WRITTEN.channels,
            findings=_AS_WRITTEN.findings,
            frf=unusable("averages|blocks", "8 samples"),
        ),
    ),
    _changed(
        "a window there is not",
        "averages = 4",
        "averages = 4\nwindow = 'hanning2'",
        Read(
            runs=2,
            channels=_AS_WRITTEN.channels,
            findings=_AS_WRITTEN.findings,
            frf=unusable("window", "hanning2"),
        ),
    ),
)

ROLES = (
    _changed(
        "a position twice",
        "A01 = 0.0, REF = 2.5",
        "A01 = 0.0, REF = 2.5, A01 = 1.0",
        bad_manifest("campaign.toml", "TOML"),
    ),
    _changed(
        "a position of no channel",
        "A01 = 0.0",
        "A10 = 0.0",
        bad_manifest("runs.1 \\(a.uff\\), positions_deg", "'A10'", "Did you mean 'A01'"),
    ),
    _changed(
        "a reference there is not",
        'reference = "REF"',
        'reference = "RFE"',
        bad_manifest("runs.1 \\(a.uff\\), reference", "'RFE'", "Did you mean 'REF'"),
    ),
    _changed(
        "the force as reference",
        'reference = "REF"',
        'reference = "force"',
        bad_manifest("reference", "force", "cannot be"),
    ),
    _changed(
        "a reference that moves",
        "A01 = 90.0, REF = 2.5",
        "A01 = 90.0, REF = 7.5",
        bad_manifest("reference", "7.5", "2.5", "stay in place"),
    ),
    _changed(
        "a force there is not",
        'channel = "force"',
        'channel = "Force"',
        bad_manifest("excitation.channel", "'Force'", "Did you mean 'force'"),
    ),
    _changed(
        "a tangential force",
        'channel = "force"',
        'channel = "force"\ndirection = "tangential"',
        bad_manifest("excitation.direction", "'tangential'", "radial"),
    ),
    _changed(
        "an axial force",
        'channel = "force"',
        'channel = "force"\ndirection = "axial"',
        bad_manifest("excitation.direction", "'axial'", "radial"),
    ),
    _changed(
        "an acceleration as force",
        'channel = "force"',
        'channel = "A01"',
        bad_manifest("excitation.channel|runs.1", "'A01' measures acceleration", "force"),
    ),
    _changed(
        "a run twice",
        '"b.uff"',
        '"a.uff"',
        bad_manifest("runs.2.file", "'a.uff'", "run 1 names the same file"),
    ),
    _changed(
        "a run twice under another name",
        '"b.uff"',
        '"./a.uff"',
        bad_manifest("runs.2.file", "'./a.uff'", "run 1 names the same file"),
    ),
    _changed(
        "a run that is a copy",
        '"b.uff"',
        '"c.uff"',
        bad_file("c.uff", "a.uff", "duplicate"),
        more={"c.uff": _RUN},
    ),
)

PATHS = tuple(
    _changed(
        f"path {path}",
        '"a.uff"',
        f"'{path}'" if "\\u" not in path else f'"{path}"',
        bad_manifest("campaign.toml, runs", "within its folder|does not exist|at least 1"),
        more={
            "loop.uff": Link("loop.uff"),
            "ring_1.uff": Link("ring_2.uff"),
            "ring_2.uff": Link("ring_1.uff"),
            "out.uff": Link("/etc/hostname"),
            "away": Link("/etc"),
            "dead.uff": Link("nothing.uff"),
        },
    )
    for path in (
        "/etc/passwd",
        "../a.uff",
        "x/../../a.uff",
        "away/hostname",
        "out.uff",
        "loop.uff",
        "ring_1.uff",
        "dead.uff",
        "a\\u0000.uff",
        "a" * 5000 + ".uff",
        "",
        "\\u202e.uff",
    )
)

_PLAIN = {"a.uff": force() + sensor()}
_ONE = Read(first={"force": tuple(FORCE[:4])})
FOLDERS = (
    Scenario("folder empty", {"sub": Folder}, bad_file("no recordings")),
    Scenario("folder that is not there", {}, bad_file("file not found"), "nowhere"),
    Scenario("file name too long", {}, bad_file("file not found"), "a" * 300 + ".uff"),
    Scenario("folder name too long", {}, bad_file("file not found"), "a" * 300),
    Scenario("manifest name too long", {}, bad_manifest("too long"), "a" * 300 + ".toml"),
    Scenario("folder called a.uff alone", {"a.uff": Folder}, bad_file("no recordings")),
    Scenario("folder called b.uff beside", {**_PLAIN, "b.uff": Folder}, _ONE),
    Scenario(
        "folder called a.uff handed over",
        {"a.uff": Folder},
        bad_file("recordings|not a file"),
        "a.uff",
    ),
    Scenario(
        "folder of a desktop",
        {
            **_PLAIN,
            ".DS_Store": b"\x00\x00\x00\x01Bud1",
            "Thumbs.db": b"\xd0\xcf\x11\xe0",
            "desktop.ini": b"[x]",
            "notes.txt": b"loud",
        },
        _ONE,
    ),
    Scenario(
        "folder with resource forks",
        {**_PLAIN, "._a.uff": b"\x00\x05\x16\x07" + bytes(80), ".a.uff.swp": b"b0VIM"},
        _ONE,
    ),
    Scenario(
        "folder with the same file twice",
        {**_PLAIN, "b.uff": _PLAIN["a.uff"]},
        bad_file("b.uff", "a.uff", "duplicate"),
    ),
    Scenario(
        "folder with a dead link",
        {**_PLAIN, "b.uff": Link("nowhere.uff")},
        bad_file("b.uff", "not found"),
    ),
    Scenario(
        "folder with a name of no UTF-8",
        {**_PLAIN, "b\udcff.uff": _RUN[::-1]},
        bad_file("b.{1,10}.uff", "begins with"),
    ),
    Scenario(
        "folder whose manifest is a folder",
        {**_PLAIN, "campaign.toml": Folder},
        bad_manifest("campaign.toml", "directory|folder"),
    ),
    Scenario("file of an unknown ending", {"a.xyz": b"1"}, bad_file("'.xyz'", ".uff"), "a.xyz"),
    Scenario("file without an ending", {"a": b"1"}, bad_file("''", ".uff"), "a"),
)

SCENARIOS = (*WRITING, *VALUES, *ROLES, *PATHS, *FOLDERS)
