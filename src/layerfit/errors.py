"""The one exception that wrong input raises."""


class InputError(ValueError):
    """Something given to layerfit is wrong: the message is one line naming what, where, what was given and what is allowed.

    row : which of many values is meant, counted from 0; a reader of files turns it into a line.
    """

    def __init__(self, message: str, *, row: int | None = None):
        super().__init__(message)
        self.row = row


def one_of(value: str, allowed: tuple[str, ...], what: str) -> None:
    """Raise InputError for a value that is not among those allowed."""
    if value not in allowed:
        raise InputError(f"{what} = {value!r}; allowed: {', '.join(allowed)}")
