"""What callers may want to act on: bad input, a fit that cannot be done, doubtful data."""


class InputError(ValueError):
    """Input that cannot be used; its message says where, what, why and what to do.

    Parameters
    ----------
    where : str
        File and place in it, e.g. ``"config_3.uff, dataset 4"``.
    found : str
        The value found, e.g. ``"49857 of 79292 values"``.
    rule : str
        The rule it breaks, e.g. ``"the file is truncated"``.
    remedy : str
        What the user can do, as a sentence without its full stop, or as a question.
    """

    def __init__(self, where: str, found: str, rule: str, remedy: str) -> None:
        end = "" if remedy.endswith("?") else "."
        super().__init__(f"{where}: {found}; {rule}. {remedy}{end}")
        self.where = where
        self.found = found
        self.rule = rule
        self.remedy = remedy

    def __reduce__(self) -> tuple[type, tuple[str, str, str, str]]:
        """Keep the four parts when the error travels between processes."""
        return type(self), (self.where, self.found, self.rule, self.remedy)


class RecordingFormatError(InputError):
    """A recording is missing, damaged, truncated or of an unknown format."""


class ManifestError(InputError):
    """A campaign's manifest is missing, unreadable or contradicts the recordings."""


class FitError(RuntimeError):
    """An identification step cannot be carried out on these data."""


class DataQualityWarning(UserWarning):
    """Data that can be used, but less well than they should be."""
