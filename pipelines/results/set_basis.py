"""What a parameter set rests on: its pressure model, verdict, warnings and covariance, in TOML."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Any, get_args

from ema.core.errors import InputError
from model.adequacy import Evidence, Reason, RingVerdict, State
from model.coefficients import PressureLoad

SECTIONS = ("model", "verdict", "covariance", "measured")
_REASONS = {str(reason): reason for reason in Reason}


@dataclass(frozen=True)
class Covariance:
    """Covariance of the parameters of a set, SI."""

    parameters: tuple[str, ...]  # rows and columns
    values: tuple[tuple[float, ...], ...]

    def without(self, name: str) -> Covariance:
        """That of the other parameters."""
        kept = [k for k, own in enumerate(self.parameters) if own != name]
        rows = tuple(tuple(self.values[k][j] for j in kept) for k in kept)
        return Covariance(tuple(self.parameters[k] for k in kept), rows)


@dataclass(frozen=True)
class MeasuredOrder:
    """Frequency and damping of one order as measured on the fixed rim; None where unknown."""

    order: int
    frequency_hz: float
    damping_ratio: float
    frequency_std_hz: float | None = None
    damping_ratio_std: float | None = None


@dataclass(frozen=True)
class Basis:
    """What a parameter set rests on.

    Parameters
    ----------
    pressure_load : {"dead", "follower"} or None
        Pressure model that the values belong to. Values of sets that do not state one are used as
        they are: with a dead load for waves, a follower load for torsion and free wheel.
    verdict : RingVerdict or None
        None for values that no tuning gave.
    warnings : tuple of str
        Doubtful findings of the campaign, as ``check: detail``.
    covariance : Covariance or None
    measured : tuple of MeasuredOrder
    """

    pressure_load: PressureLoad | None = None
    verdict: RingVerdict | None = None
    warnings: tuple[str, ...] = ()
    covariance: Covariance | None = None
    measured: tuple[MeasuredOrder, ...] = ()

    @property
    def state(self) -> State | None:
        """State of the verdict; None where there is none."""
        return None if self.verdict is None else self.verdict.state

    @property
    def is_in_doubt(self) -> bool:
        """Whether there is a verdict and it is not good."""
        return self.verdict is not None and not self.verdict.is_good

    @property
    def on_fixed_rim(self) -> dict[int, MeasuredOrder]:
        """Measured orders that belong to the ring: not order 1 where the rim moves."""
        doubted: set[int | None] = set()
        if self.verdict is not None:
            doubted |= {*self.verdict.orders_left_out}
            doubted |= {each.order for each in self.verdict.evidence if each.order is not None}
            if any(each.reason is Reason.RIM for each in self.verdict.evidence):
                doubted.add(1)
        return {each.order: each for each in self.measured if each.order not in doubted}


def accepted_verdict(name: str, basis: Basis, *, accept_warnings: bool) -> str:
    """The verdict on a set where it is not good; `InputError` unless that is accepted."""
    if basis.verdict is None or basis.verdict.is_good:
        return ""
    if not accept_warnings:
        rule = "what leaves the laboratory needs a good verdict, or the word that it is accepted"
        remedy = "Measure again, or accept it (--accept-warnings, accept_warnings=True)"
        raise InputError(name, f"verdict {basis.verdict.text()}", rule, remedy)
    return basis.verdict.text()


def basis_records(basis: Basis) -> dict[str, dict[str, Any]]:
    """Sections of a TOML file."""
    records: dict[str, dict[str, Any]] = {}
    if basis.pressure_load is not None:
        records["model"] = {"pressure_load": basis.pressure_load}
    if (verdict := basis.verdict) is not None:
        records["verdict"] = {
            "state": verdict.state.value,
            "reasons": [
                {"reason": each.reason.value, "detail": each.detail}
                | ({} if each.order is None else {"order": each.order})
                for each in verdict.evidence
            ],
            **({} if verdict.chi2 is None else {"chi2": float(verdict.chi2)}),
            "degrees_of_freedom": verdict.degrees_of_freedom,
            "orders_used": list(verdict.orders_used),
            "orders_left_out": list(verdict.orders_left_out),
            "warnings": list(basis.warnings),
        }
    if (covariance := basis.covariance) is not None:
        rows = [list(row) for row in covariance.values]
        records["covariance"] = {"parameters": list(covariance.parameters), "values": rows}
    if basis.measured:
        orders = [{k: v for k, v in vars(each).items() if v is not None} for each in basis.measured]
        records["measured"] = {"orders": orders}
    return records


def basis_of(path: Path, sections: dict[str, dict[str, Any]], known: tuple[str, ...]) -> Basis:
    """Basis from the sections of a TOML file; `known` are the names of parameters."""
    load = sections["model"].get("pressure_load")
    if load not in (None, *get_args(PressureLoad)):
        where, rule = f"{path.name}, [model] pressure_load", "it must be dead or follower"
        raise InputError(where, repr(load), rule, "Correct it")
    record, covariance = sections["verdict"], sections["covariance"]
    try:
        return Basis(
            load,
            _verdict(record) if record else None,
            tuple(map(str, record.get("warnings", ()))),
            _covariance(covariance, known) if covariance else None,
            tuple(map(_measured, sections["measured"].get("orders", ()))),
        )
    except (KeyError, TypeError, ValueError) as error:
        where, rule = f"{path.name}, [verdict], [covariance], [measured]", "they must be as written"
        raise InputError(where, str(error), rule, "Remove the sections or tune again") from error


def _verdict(record: dict[str, Any]) -> RingVerdict:
    verdict = RingVerdict(
        tuple(
            Evidence(_REASONS[each["reason"]], str(each["detail"]), each.get("order"))
            for each in record["reasons"]
        ),
        float(record["chi2"]) if "chi2" in record else None,
        int(record["degrees_of_freedom"]),
        tuple(map(int, record["orders_used"])),
        tuple(map(int, record["orders_left_out"])),
    )
    if record["state"] != verdict.state:
        raise ValueError(f"state {record['state']!r} for the reasons of {verdict.state.value!r}")
    return verdict


def _measured(record: dict[str, Any]) -> MeasuredOrder:
    if not isinstance(record, dict):
        raise TypeError(f"order {record!r} is no table")
    values = {name: float(value) for name, value in record.items() if name != "order"}
    if not all(isfinite(value) and value > 0 for value in values.values()):
        raise ValueError(f"order {record['order']} with a value that is not > 0")
    return MeasuredOrder(int(record["order"]), **values)


def _covariance(record: dict[str, Any], known: tuple[str, ...]) -> Covariance:
    names = tuple(map(str, record["parameters"]))
    values = tuple(tuple(map(float, row)) for row in record["values"])
    if not set(names) <= set(known) or [len(row) for row in values] != [len(names)] * len(names):
        raise ValueError(f"{len(values)} rows for the parameters {', '.join(names)}")
    if not all(isfinite(value) for row in values for value in row):
        raise ValueError("a covariance that is not finite")
    return Covariance(names, values)
