"""Units and sensitivities from the manifest: what volts become, and what is refused."""

import re

import numpy as np
import pytest

import ema
from ema.core.errors import ManifestError
from ema.io.campaign.axes import parse_sensitivity

G = 9.80665
TABLE = "time [s],force [V],A01 [mV],A02\n0,0.5,10,1\n0.001,-0.25,20,2\n0.002,1,-5,3\n"
MANIFEST = """
schema = 1
[excitation]
channel = "force"
[calibration]
force = {{ sensitivity = "2.5 mV/N" }}
"A*" = {{ {any_sensor} }}
A02 = {{ {second} }}
[[runs]]
file = "run.csv"
"""


@pytest.mark.parametrize(
    ("text", "quantity", "volts_per_si"),
    [
        ("10.2 mV/g", "acceleration", 0.0102 / G),
        ("10,2 mV/g", "acceleration", 0.0102 / G),
        ("1.02 mV/(m/s^2)", "acceleration", 0.00102),
        ("1.02mV/m/s²", "acceleration", 0.00102),
        ("-100 mV/g", "acceleration", -0.1 / G),
        ("2.25 mV/N", "force", 0.00225),
        ("11.2 mV/lbf", "force", 0.0112 / 4.4482216152605),
        ("1e3 (m/s^2)/V", "acceleration", 1e-3),
        ("22.4 N/V", "force", 1 / 22.4),
        ("0,102 V/g", "acceleration", 0.102 / G),
    ],
)
def test_sensitivities_as_calibration_sheets_print_them(text, quantity, volts_per_si):
    found = parse_sensitivity(text)
    assert found.quantity == quantity
    assert found.volts_per_si == pytest.approx(volts_per_si, rel=1e-14)


@pytest.mark.parametrize(
    "text", ["", "10.2", "mV/g", "10 mV", "10 g/N", "10 mV/V", "0 mV/g", "1,000 mV/g", "1.2.3 mV/g"]
)
def test_what_is_no_sensitivity(text):
    assert parse_sensitivity(text) is None


@pytest.fixture
def campaign(tmp_path):
    def build(any_sensor='sensitivity = "10 mV/g"', second='unit = "g"', old="", new=""):
        (tmp_path / "run.csv").write_text(TABLE)
        text = MANIFEST.format(any_sensor=any_sensor, second=second)
        assert old in text
        (tmp_path / "campaign.toml").write_text(text.replace(old, new, 1))
        return ema.read_campaign(tmp_path)

    return build


def test_volts_become_physical_and_the_result_says_so(campaign):
    found = campaign()
    (run,) = found.runs
    np.testing.assert_allclose(run.force.block(0, 3), [200.0, -100.0, 400.0], rtol=1e-14)
    first, second = (response.channel for response in run.responses)
    np.testing.assert_allclose(first.block(0, 3), [G, 2 * G, -G / 2], rtol=1e-14)
    np.testing.assert_allclose(second.block(0, 3), [G, 2 * G, 3 * G], rtol=1e-14)
    recorded = {each.channel: each.detail for each in found.findings if each.check == "calibration"}
    assert recorded == {
        "force": "2.5 mV/N by the manifest",
        "A01": "10 mV/g by the manifest",
        "A02": "g by the manifest",
    }


def test_the_manifest_corrects_a_unit_and_that_is_a_warning(campaign):
    found = campaign(any_sensor='unit = "mm/s^2"')
    assert found.runs[0].responses[0].channel.block(0, 1)[0] == pytest.approx(0.01)
    details = [each.detail for each in found.findings if each.verdict == "warning"]
    assert "the file states 'mV', the manifest 'mm/s^2' and decides" in details


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"second": 'unit = "foo"'}, "calibration.A02.unit: 'foo'; it is not known"),
        ({"second": 'sensitivity = "10"'}, "calibration.A02.sensitivity: '10'; "),
        ({"second": 'sensitivity = ""'}, "calibration.A02.sensitivity: ''; "),
        ({"second": 'unit = "g", sensitivity = "10 mV/g"'}, "in 'g' in run.csv"),
        ({"old": "A02 =", "new": "A03 ="}, "no recording has a channel of that name"),
        ({"second": ""}, "calibration.A02: {}; "),
        ({"second": 'unt = "g"'}, "Did you mean 'unit'?"),
        ({"old": 'force = { sensitivity = "2.5 mV/N" }\n'}, 'force = { sensitivity = "…" }'),
    ],
)
def test_faults_are_named(campaign, changes, message):
    with pytest.raises(ManifestError, match=re.escape(message)):
        campaign(**changes)
