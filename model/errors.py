"""Refusals of the ring model: parameters that describe no ring, states that cannot hold."""


class ParameterError(ValueError):
    """A parameter that the ring model refuses; its message says where, what, why and what to do.

    Parameters
    ----------
    where : str
        The parameter or the argument, e.g. ``"radial_stiffness_n_m3"``.
    found : str
        The value found.
    rule : str
        The rule it breaks.
    remedy : str
        What the user can do, as a sentence without its full stop.

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
        self.where = where
        self.found = found
        self.rule = rule
        self.remedy = remedy

    def __reduce__(self) -> tuple[type, tuple[str, str, str, str]]:
        """Keep the four parts when the error travels between processes."""
        return type(self), (self.where, self.found, self.rule, self.remedy)


class InstabilityError(ParameterError):
    """A state of the ring that grows instead of vibrating: it has no natural frequency."""
