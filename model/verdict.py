"""The verdict on a tuned ring: how far it may be relied upon, and what speaks against it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Any


class State(StrEnum):
    """How far a tuned ring may be relied upon."""

    GOOD = "good"
    DOUBTFUL = "doubtful"
    BAD = "bad"


class Reason(StrEnum):
    """What speaks against the ring: the name in ``tyre.toml``, its `meaning` and its `state`."""

    meaning: str
    state: State

    def __new__(cls, name: str, meaning: str, state: State) -> Reason:
        """Make the member that equals its name."""
        member = str.__new__(cls, name)
        member._value_, member.meaning, member.state = name, meaning, state
        return member

    RIM = "rim moves", "two modes of order 1: the rim or its fixture moves", State.BAD
    TURNING = "rim turns", "two torsions: the rim turns on its fixture", State.DOUBTFUL
    SHIFTED = "orders shifted", "the ring fits better with all orders moved by one", State.BAD
    MISFIT = "misfit", "no ring has these frequencies", State.BAD
    ORDER = "order", "one order does not belong to the ring of the others", State.DOUBTFUL
    DEVIATION = "deviation", "the ring deviates more than rings do from tyres", State.DOUBTFUL
    MASSES = "modal masses", "modal masses contradict the frequencies", State.DOUBTFUL
    TORSION = "torsion", "the torsion contradicts the frequencies", State.DOUBTFUL
    UNTESTED = "untested", "no more orders than unknowns: nothing tests the ring", State.DOUBTFUL
    BOUND = "at bound", "a parameter ended on a limit", State.DOUBTFUL
    ORDER_1 = "order 1 not tested", "order 1 not tested without torsion", State.GOOD
    NUMBERS = "orders not tested", "frequencies alone do not test the orders' numbers", State.GOOD


@dataclass(frozen=True)
class Evidence:
    """One reason against a tuned ring, or what nothing tests (state good).

    Parameters
    ----------
    reason : Reason
    detail : str
        What was found and the limit, in words.
    order : int or None
        Circumferential order that it is about.
    """

    reason: Reason
    detail: str
    order: int | None = None


@dataclass(frozen=True)
class RingVerdict:
    """Verdict on a tuned ring.

    Parameters
    ----------
    evidence : tuple of Evidence
        What speaks against the ring, and what its data cannot test.
    chi2 : float or None
        Sum of squared deviations of the frequencies over their own variance and that of the model
        form; None where it has no degrees of freedom.
    degrees_of_freedom : int
        Number of frequencies less the free parameters they determine.
    orders_used, orders_left_out : tuple of int
        Circumferential orders that the ring was tuned on, and measured ones it was not.
    """

    evidence: tuple[Evidence, ...]
    chi2: float | None
    degrees_of_freedom: int
    orders_used: tuple[int, ...]
    orders_left_out: tuple[int, ...] = ()

    @property
    def state(self) -> State:
        """The worst state that a piece of evidence implies."""
        states = {each.reason.state for each in self.evidence}
        return next((each for each in (State.BAD, State.DOUBTFUL) if each in states), State.GOOD)

    @property
    def is_good(self) -> bool:
        """Whether nothing speaks against the ring."""
        return self.state is State.GOOD

    @property
    def against(self) -> tuple[Evidence, ...]:
        """What speaks against the ring."""
        return tuple(each for each in self.evidence if each.reason.state is not State.GOOD)

    @property
    def record(self) -> dict[str, Any]:
        """The verdict as ``tyre.toml`` has it."""
        return {
            "state": self.state.value,
            "reasons": [
                {"reason": each.reason.value, "detail": each.detail}
                | ({} if each.order is None else {"order": each.order})
                for each in self.evidence
            ],
            **({} if self.chi2 is None else {"chi2": float(self.chi2)}),
            "degrees_of_freedom": self.degrees_of_freedom,
            "orders_used": list(self.orders_used),
            "orders_left_out": list(self.orders_left_out),
        }

    @classmethod
    def of_record(cls, record: dict[str, Any]) -> RingVerdict:
        """The verdict of a `record`; `KeyError`, `TypeError` or `ValueError` where it is none."""
        reasons = {reason.value: reason for reason in Reason}
        found = cls(
            tuple(
                Evidence(reasons[each["reason"]], str(each["detail"]), each.get("order"))
                for each in record["reasons"]
            ),
            float(record["chi2"]) if "chi2" in record else None,
            int(record["degrees_of_freedom"]),
            tuple(map(int, record["orders_used"])),
            tuple(map(int, record["orders_left_out"])),
        )
        if record["state"] != found.state:
            raise ValueError(f"state {record['state']!r} for the reasons of {found.state.value!r}")
        return found

    def text(self) -> str:
        """The verdict in a sentence."""
        return f"{self.state}: " + (
            "; ".join(e.detail for e in self.evidence) or "nothing doubtful"
        )
