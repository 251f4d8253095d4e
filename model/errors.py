"""Errors of the ring model: invalid parameters, unstable states."""

from __future__ import annotations


class ParameterError(ValueError):
    """An invalid parameter of the ring model; the message names place, value, rule and remedy.

    Parameters
    ----------
    where : str
        The parameter or the argument, e.g. ``"radial_stiffness_n_m3"``.
    found : str
        The value found.
    rule : str
        The rule it breaks.
    remedy : str
        What to do, as a sentence without its full stop.

    Examples
    --------
    >>> import ringmodal as rm
    >>> try:
    ...     rm.RingDamping(-1.0, 0.0, 0.02)
    ... except rm.ParameterError as error:
    ...     print(error.where)
    radial_n_s_m3
    """

    def __init__(self, where: str, found: str, rule: str, remedy: str) -> None:
        super().__init__(f"{where}: {found}; {rule}. {remedy}.")
        self.where, self.found, self.rule, self.remedy = where, found, rule, remedy

    def __reduce__(self) -> tuple[type, tuple[str, str, str, str]]:
        """Keep the four parts when the error travels between processes."""
        return type(self), (self.where, self.found, self.rule, self.remedy)


class InstabilityError(ParameterError):
    """A state of the ring that grows instead of vibrating: it has no natural frequency."""
