"""`jammkle rename`: write a bag anew under names that the other verbs know."""

from __future__ import annotations

import shutil
from typing import TYPE_CHECKING

from jammkle_bringup.core.renaming import JointRenaming, RenamingError
from jammkle_common.bags.writing import check_free
from jammkle_common.command import results
from jammkle_common.command.errors import GraphError, InputError, StopRequest
from jammkle_common.command.results import progress_bar

if TYPE_CHECKING:
    from pathlib import Path


def rename(bag: Path, target: Path, joints: list[str], topics: list[str], json: Path | None) -> int:
    """Write the new bag and return the exit code.

    Raises:
        InputError: the bag cannot be read, or something cannot be as asked for.
        GraphError: the new bag cannot be written.
        Interrupted: asked to stop; nothing is left.

    """
    from jammkle_bringup.core.renamed_bag import RenamingRequest, topics_of  # noqa: PLC0415 - loads NumPy
    from jammkle_bringup.core.renamed_bag import rename as write_anew  # noqa: PLC0415 - as above

    if not joints and not topics:
        msg = "nothing to rename: give --joint theirs=ours or --topic /theirs=/ours"
        raise InputError(msg)
    try:
        request = RenamingRequest(bag, target, JointRenaming.parsed(",".join(joints)), topics_of(topics))
    except RenamingError as error:
        raise InputError(str(error)) from error
    results.check_writable(json)
    check_free(target)
    done = None
    try:
        with progress_bar(f"reading {bag}") as show:
            done = write_anew(request, lambda share: show(share, ""), StopRequest())
    except OSError as error:
        msg = f"bag {target} cannot be written: {error.strerror or error}"
        raise GraphError(msg) from error
    finally:
        if done is None:
            shutil.rmtree(target, ignore_errors=True)
    text = f"{target}: {done.messages} messages"
    text += f", {done.joint_messages} of them with renamed joints" if request.joints.new else ""
    results.console().print(text, markup=False)
    results.write_json(json, done.as_json())
    return 0
