"""The one exception for bad input: the command turns it into one line and exit code 2."""


class InputError(ValueError):
    """Something that was asked for cannot be done. The message is one line: the value, the limit, the way out."""


class GraphError(RuntimeError):
    """The graph did not do what was asked for. The message is one line; the command exits with 1."""
