"""The one exception that wrong input raises."""

import difflib
from collections.abc import Iterable


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


def closest(word: str, known: Iterable[str]) -> str:
    """The end of a message about a word that is not known.

    >>> closest("thicknes", ["name", "thickness"]), closest("x", ["thickness"])
    ('; did you mean thickness?', '')
    """
    match = difflib.get_close_matches(word, list(known), 1)
    return f"; did you mean {match[0]}?" if match else ""
