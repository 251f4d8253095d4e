"""Windows and triggers that headers state reach the processing, or are named as not used."""

from pathlib import Path

import h5py
import nptdms
import numpy as np
import pytest
from builders import binary58, dataset, floats, force58, frf58, response58, row
from scipy.io import savemat

import ema
from ema.io.content import WindowKind, entries, stated_windows
from ema.io.formats import read_file

N, RATE_HZ = 64, 2000.0
FORCE, A01 = np.random.default_rng(0).normal(size=(2, N))
EXPONENTIAL, IMPACT = WindowKind.EXPONENTIAL, WindowKind.FORCE


@pytest.mark.parametrize(
    ("name", "value", "expected"),
    [
        ("exponential_window_s", 0.5, [(EXPONENTIAL, 0.5)]),
        ("Exponential window time constant (ms)", "250", [(EXPONENTIAL, 0.25)]),
        ("ExpWindowTau_s", np.array([[0.5]]), [(EXPONENTIAL, 0.5)]),
        ("run/A01/Exponential window", "0.5 s", [(EXPONENTIAL, 0.5)]),
        ("Exponential window", "5 %", [(EXPONENTIAL, None)]),  # at the end of a block
        ("exponential_window_decay_s", 0.5, [(EXPONENTIAL, None)]),  # to which level?
        ("exponential_window_s", -1, [(EXPONENTIAL, None)]),
        ("Window", "Exponential", [(EXPONENTIAL, None)]),
        ("force_window_length_s", 0.02, [(IMPACT, 0.02)]),
        ("Window type", "Impact and Exponential", [(EXPONENTIAL, None), (IMPACT, None)]),
        ("Window", "Rectangular", []),
        ("Window", 0, []),
        ("Exponential window", "off", []),
        ("expected width_s", 0.5, []),
    ],
)
def test_windows_by_their_names(name, value, expected):
    windows, findings = stated_windows(Path("a.uff"), {name: value})
    assert [(each.kind, each.seconds) for each in windows] == expected
    assert findings == ()


def test_all_other_treatment_is_named():
    stated = {
        "Window": "Hanning",
        "Pretrigger [s]": 0.01,
        "Trigger level": b"5 N",
        "Trigger": "off",
    }
    windows, (finding,) = stated_windows(Path("a.uff"), stated)
    assert windows == ()
    assert finding.check == "ignored"
    for each in ("Window = Hanning", "Pretrigger [s] = 0.01", "Trigger level = 5 N"):
        assert each in finding.detail


def test_entries_of_text():
    assert entries(["a b: 0.5 s", "c=1", "no entry", "18-Apr-16"]) == {"a b": "0.5 s"}


def uff(path):
    line = "Exponential window: 0.5 s"
    content = force58() + response58().replace(b"18-Apr-16 13:49:58", line.encode())
    path.write_bytes(content)


def tdms(path):
    step = {"wf_increment": 1 / RATE_HZ}
    channels = [
        nptdms.ChannelObject("run", name, samples, properties={"unit_string": unit, **step, **more})
        for name, unit, samples, more in (
            ("force", "N", FORCE, {"Trigger_Level": 5.0}),
            ("A01", "g", A01, {"exponential_window_s": 0.5}),
        )
    ]
    with nptdms.TdmsWriter(path) as file:
        file.write_segment(channels)


def hdf5(path):
    with h5py.File(path, "w") as file:
        file.attrs.update({"fs": RATE_HZ, "exponential_window_s": 0.5, "trigger": "force, 5 N"})
        for name, unit, samples in (("force", "N", FORCE), ("A01", "g", A01)):
            file[name] = samples
            file[name].attrs["unit"] = unit


def matlab(path):
    windows = {"exponential_window_s": 0.5, "trigger": {"level": 5.0}}
    savemat(path, {"fs": RATE_HZ, "force": FORCE, "A01": A01, **windows})


def lvm(path):
    rows = "".join(f"{f:.6f}\t{a:.6f}\n" for f, a in zip(FORCE, A01, strict=True)).replace(
        "\n", "\n\t"
    )
    path.write_text(
        "LabVIEW Measurement\t\nSeparator\tTab\nX_Columns\tNo\nExponential window\t0.5 s\n"
        "***End_of_Header***\t\n\nChannels\t2\nSamples\t64\t64\nTrigger level\t5 N\n"
        "Y_Unit_Label\tN\tg\nX_Dimension\tTime\tTime\nX0\t0\t0\nDelta_X\t0.0005\t0.0005\n"
        f"***End_of_Header***\t\t\nX_Value\tforce\tA01\tComment\n\t{rows.rstrip()}\n"
    )


def csv(path):
    rows = "".join(f"{f:.6f};{a:.6f}\n" for f, a in zip(FORCE, A01, strict=True))
    above = "Exponential window;0.5 s\n# Trigger level: 5 N;;\nSampling rate;2000\n"
    path.write_text(f"{above}force [N];A01 [g]\n{rows}")


@pytest.mark.parametrize(
    "write", [uff, tdms, hdf5, matlab, lvm, csv], ids=lambda each: each.__name__
)
def test_files_of_each_format(tmp_path, write):
    path = tmp_path / f"a.{ {'matlab': 'mat', 'hdf5': 'h5'}.get(write.__name__, write.__name__) }"
    write(path)
    found = read_file(path)
    assert {(each.kind, each.seconds) for each in found.windows} == {(EXPONENTIAL, 0.5)}
    if write is not uff:
        assert any("stated in the file, not used" in each.detail for each in found.findings)


@pytest.mark.parametrize("ending", ["csv", "mat", "h5"])
def test_windows_of_frfs_outside_of_universal_files(tmp_path, ending):
    path, lines, values = tmp_path / f"a.{ending}", np.arange(1.0, 81.0), np.linspace(1, 2, 80) + 1j
    if ending == "csv":
        rows = "".join(f"{f},{h.real},{h.imag}\n" for f, h in zip(lines, values, strict=True))
        path.write_text(f"Exponential window: 0.5 s\nf [Hz],H1 real [g/N],H1 imag [g/N]\n{rows}")
    elif ending == "mat":
        savemat(path, {"f": lines, "H1": values, "exponential_window_s": 0.5})
    else:
        with h5py.File(path, "w") as file:
            file.attrs["exponential_window_s"] = 0.5
            file["f"], file["H1"] = lines, values
    assert [(w.kind, w.seconds) for w in read_file(path).windows] == [(EXPONENTIAL, 0.5)]


def qualifiers(window):
    return dataset(
        1858,
        row("12d " * 6, 1, 0, 1, 0, 0, 0),
        row("6d " * 12, 0, window, *[0] * 10),
        *[row("15.7E " * 5, *[0.0] * 5)] * 3,
        "  X+  X+",
        "NONE",
    )


def campaign(folder, *contents, line=""):
    runs = ""
    for number, content in enumerate(contents, 1):
        (folder / f"{number}.uff").write_bytes(content)
        runs += f'[[runs]]\nfile = "{number}.uff"\n'
    (folder / "campaign.toml").write_text(f"schema = 1\n[processing]\n{line}\n{runs}")
    found = ema.read_campaign(folder)
    return found, [(f.verdict, f.detail) for f in found.findings if f.check == "window"]


def frf(window="", node=1):
    values = np.linspace(1, 2, 80) + 1j
    return frf58(values, node=node).replace(b"18-Apr-16 13:49:58", window.encode() or b"NONE")


def test_a_window_of_frfs_reaches_the_processing(tmp_path):
    content = frf("Exponential window: 0.5 s"), frf("Exponential window: 0.5 s", node=2)
    found, ((verdict, _),) = campaign(tmp_path, *content)
    assert found.processing.exponential_window_s == 0.5
    assert verdict == "ok"
    assert ema.estimate_frf(found).exponential_window.time_constant_s == 0.5


def test_the_manifest_comes_first(tmp_path):
    found, windows = campaign(
        tmp_path, frf("Exponential window: 0.5 s"), line="exponential_window_s = 0.4"
    )
    assert found.processing.exponential_window_s == 0.4
    assert windows == []


@pytest.mark.parametrize(
    "contents",
    [
        (frf("Exponential window: 0.5 s"), frf("Exponential window: 0.4 s", node=2)),
        (frf("Exponential window: 0.5 s"), frf(node=2)),
        (frf() + qualifiers(4),),  # the standard has no unit for its damping factor
    ],
)
def test_a_window_without_one_time_is_a_warning_with_the_key(tmp_path, contents):
    found, ((verdict, detail),) = campaign(tmp_path, *contents)
    assert found.processing.exponential_window_s is None
    assert verdict == "warning"
    assert "Give exponential_window_s" in detail


def test_a_window_of_recordings_is_to_be_confirmed(tmp_path):
    content = force58(N, node=0) + binary58(floats(A01), n=N).replace(
        b"18-Apr-16 13:49:58", b"Exponential window: 0.5 s"
    )
    found, ((verdict, detail),) = campaign(tmp_path, content)
    assert found.processing.exponential_window_s == 0.5
    assert verdict == "warning"
    assert "to confirm" in detail
