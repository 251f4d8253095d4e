"""Parameter sets that tests of the library share."""

from dataclasses import replace

from model.verdict import Evidence, Reason, RingVerdict
from pipelines.results.parameter_set import Parameter, ParameterSet, write_parameter_set
from pipelines.results.verdict import Basis

DESIGNATION = "225/55R17"
SET = ParameterSet(
    DESIGNATION,
    {"inflation_pressure_pa": 220000.0},
    {
        "mean_radius_m": Parameter(0.33),
        "belt_width_m": Parameter(0.19),
        "mass_per_area_kg_m2": Parameter(19.7, "identified", 0.2),
        "radial_stiffness_n_m3": Parameter(8.0e6, "identified", 1.0e5),
        "circumferential_stiffness_n_m3": Parameter(1.6e6, "identified", 5.0e4),
        "axial_stiffness_n_m": Parameter(2.5e7, "not identified"),
        "bending_stiffness_n_m": Parameter(7.5, "identified"),
    },
    {
        "radial_n_s_m3": Parameter(640.0, "identified", 50.0),
        "circumferential_n_s_m3": Parameter(850.0, "identified", 110.0),
        "loss_factor": Parameter(0.015, "identified", 0.003),
    },
    {},
    {"campaign": "first", "inputs": {"campaign.toml": "0", "config_1.uff": "1"}},
)


def varied(recording="2", pressure_pa=220000.0, *, designation=DESIGNATION, **values):
    """The set from other recordings, with other values, which keep σ and origin."""
    ring = {name: replace(own, value=values.get(name, own.value)) for name, own in SET.ring.items()}
    return replace(
        SET,
        designation=designation,
        conditions={"inflation_pressure_pa": pressure_pa},
        ring=ring,
        provenance={"campaign": recording, "inputs": {"config_1.uff": recording}},
    )


def doubted(reason=Reason.RIM, parameters=SET):
    """The set with a verdict that is not good, and warnings."""
    evidence = Evidence(reason, "two modes of order 1: 79 and 95 Hz", 1)
    verdict = RingVerdict((evidence,), 2500.0, 3, (1, 2, 3))
    return replace(parameters, basis=Basis("dead", verdict=verdict, warnings=("hum: 50 Hz",) * 7))


def written(path, parameters=SET):
    """A parameter set as a file."""
    write_parameter_set(path, parameters)
    return path
