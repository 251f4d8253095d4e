"""Thresholds of the manifest and of Python: used, recorded, read back."""

import pytest

from ema.core.errors import InputError
from ema.core.settings import CheckSettings, IdentificationSettings
from pipelines.process.run import process
from pipelines.report.write import save
from pipelines.results.options import Options, tuning_arguments, tuning_in_force
from pipelines.results.store import load

TABLES = """
[identification]
pair_p_value = 1e-6

[checks]
poor_coherence = 1.1
correct_sensors = false

[grid]"""


def verdicts(result, check):
    return {finding.verdict for finding in result.findings if finding.check == check}


def test_those_of_the_manifest_are_used_and_recorded(campaign_copy, edit_manifest, tmp_path):
    edit_manifest("[grid]", TABLES + "\n")
    result = process(campaign_copy, Options(tune=False))
    assert verdicts(result, "coherence") == {"warning"}
    settings = result.provenance["settings"]
    assert settings["identification"]["pair_p_value"] == 1e-6
    assert settings["checks"]["poor_coherence"] == 1.1
    assert settings["checks"]["correct_sensors"] is False
    save(result, tmp_path / "result", report=False)
    assert load(tmp_path / "result").provenance["settings"] == settings


def test_those_of_python_replace_those_of_the_manifest(campaign_copy, edit_manifest):
    edit_manifest("[grid]", TABLES + "\n")
    options = Options(tune=False, checks=CheckSettings(), identification=IdentificationSettings())
    result = process(campaign_copy, options)
    assert verdicts(result, "coherence") == {"ok"}
    assert result.provenance["settings"]["identification"]["pair_p_value"] == 1e-4


def test_a_loaded_reference_is_checked_with_the_recorded_threshold(short_campaign, tmp_path):
    options = Options(tune=False, checks=CheckSettings(consistent_ratio=1e-3, consistent_share=0.0))
    save(process(short_campaign, options), tmp_path / "result", report=False)
    assert not load(tmp_path / "result").reference.consistent


@pytest.mark.parametrize(
    ("table", "line"),
    [
        ("identification", "pair = 1"),
        ("checks", 'poor_coherence = "low"'),
        ("checks", "correct_sensors = 0"),
    ],
)
def test_what_is_unknown_or_not_a_number_is_refused(campaign_copy, edit_manifest, table, line):
    edit_manifest("[grid]", f"[{table}]\n{line}\n\n[grid]\n")
    with pytest.raises(InputError) as caught:
        process(campaign_copy)
    assert f"[{table}]" in caught.value.where


def test_the_tuning_of_the_manifest_yields_to_options_key_by_key():
    manifest = {
        "pressure_load": "follower",
        "radial_growth_m": {"value": 9e-4, "std": 2e-4},
        "inflation_pressure_pa": {"std": 4400.0},
        "bending_stiffness_n_m": {"lower": 1.0, "upper": 20.0, "start": 7.0},
    }
    chosen = {"radial_growth_m": {"value": 8e-4}, "pressure_load": "dead"}
    merged = tuning_in_force(manifest, chosen)
    found = tuning_arguments(
        merged, {"mass_per_area_kg_m2": 20.0}, {"inflation_pressure_pa": 2.2e5}
    )
    assert found["pressure_load"] == "dead"
    assert found["priors"].parameters == {"radial_growth_m": (8e-4, 2e-4)}
    assert found["priors"].pressure_std == pytest.approx(0.02)
    assert found["bounds"] == {"bending_stiffness_n_m": (1.0, 20.0)}
    assert found["start"] == {"bending_stiffness_n_m": 7.0}
    assert found["given"] == {"mass_per_area_kg_m2": 20.0}


@pytest.mark.parametrize("entry", [{"lower": 1.0}, {"std": 1.0}])
def test_half_a_statement_about_a_parameter_is_refused(entry):
    with pytest.raises(InputError, match=r"\[tuning\] bending_stiffness_n_m"):
        tuning_arguments({"bending_stiffness_n_m": entry}, {}, {})
