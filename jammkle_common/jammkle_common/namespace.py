"""Namespaces of ROS: check one that a person typed, and put relative names into it."""

from __future__ import annotations

import re

from jammkle_common.command.errors import InputError

MAX_LENGTH = 200
"""Most characters of a namespace. Names on the graph may have 255, node or topic included (ROS 2: rmw validates them),
and the lock file's name holds the namespace."""

_TOKEN = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


def normalised(namespace: str) -> str:
    """Return `namespace` with a leading slash and none at the end; the root is `/`.

    Raises:
        InputError: it holds characters that ROS does not allow in names, or is too long.

    """
    tokens = [token for token in namespace.strip().split("/") if token]
    for token in tokens:
        if not _TOKEN.fullmatch(token):
            msg = (
                f"namespace '{namespace}' is not a ROS name: letters, digits and underscores, "
                "not starting with a digit, parted by '/', for example lf_ankle"
            )
            raise InputError(msg)
    full = "/" + "/".join(tokens)
    if len(full) > MAX_LENGTH:
        msg = f"namespace '{full[:20]}...' has {len(full)} characters; it must have {MAX_LENGTH} at most"
        raise InputError(msg)
    return full


def resolved(namespace: str, name: str) -> str:
    """Return the absolute form of `name` in a normalised namespace; absolute names stay as they are."""
    if name.startswith("/"):
        return name
    return f"{namespace.rstrip('/')}/{name}"


def relative(namespace: str, name: str) -> str | None:
    """Return the absolute `name` as seen from a normalised namespace, or None if it lies outside of it."""
    prefix = namespace.rstrip("/") + "/"
    return name[len(prefix) :] if name.startswith(prefix) else None
