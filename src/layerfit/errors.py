"""The one exception that wrong input raises."""


class InputError(ValueError):
    """Something given to layerfit is wrong: the message is one line naming what, where, what was given and what is allowed."""
