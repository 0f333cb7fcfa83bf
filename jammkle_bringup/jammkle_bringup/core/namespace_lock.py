"""One `jammkle up` per user, ROS domain and namespace: a lock that the kernel gives back when its holder dies."""

from __future__ import annotations

import fcntl
import os
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from jammkle_common.command.errors import InputError

if TYPE_CHECKING:
    from types import TracebackType

    from typing_extensions import Self


def ros_domain() -> str:
    """Return the ROS domain of this process, as text."""
    return os.environ.get("ROS_DOMAIN_ID") or "0"


def default_folder() -> Path:
    """Return where this user's lock files live: the runtime folder of the session, or one in the temporary folder."""
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    if runtime and os.access(runtime, os.W_OK):
        return Path(runtime) / "jammkle"
    return Path(tempfile.gettempdir()) / f"jammkle-{os.getuid()}"


class NamespaceLock:
    """Context manager that holds a namespace of a ROS domain against a second `jammkle up` of the same user."""

    def __init__(self, namespace: str, domain: str, folder: Path) -> None:
        """Prepare the lock of a normalised namespace; nothing is taken yet."""
        self._namespace = namespace
        self._domain = domain
        self._path = folder / f"domain{domain}{namespace.rstrip('/').replace('/', '--')}.lock"
        self._descriptor: int | None = None

    def __enter__(self) -> Self:
        """Take the lock.

        Raises:
            InputError: another process holds it, or its file cannot be made.

        """
        descriptor = _opened(self._path)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            holder = os.pread(descriptor, 32, 0).decode(errors="replace").strip() or "unknown"
            os.close(descriptor)
            msg = already_up(self._namespace, self._domain, f"process {holder}")
            raise InputError(msg) from None
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, f"{os.getpid()}\n".encode(), 0)
        self._descriptor = descriptor
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Give the lock back. The file stays: removing it would let two processes hold two files of one name."""
        if self._descriptor is not None:
            os.close(self._descriptor)
            self._descriptor = None


class ClockLock:
    """Context manager of the one /clock that simulations of the same user make in a ROS domain.

    Two that start together do not see each other on the graph yet; this tells which of them makes the clock.
    """

    def __init__(self, domain: str, folder: Path) -> None:
        """Prepare the lock of a domain; nothing is taken yet."""
        self._path = folder / f"clock_of_domain{domain}.lock"
        self._descriptor: int | None = None

    def __enter__(self) -> Self:
        """Do nothing yet: who joins somebody else's clock needs none."""
        return self

    def take(self) -> bool:
        """Take the lock; False if another simulation has it.

        Raises:
            InputError: its file cannot be made.

        """
        descriptor = _opened(self._path)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(descriptor)
            return False
        self._descriptor = descriptor
        return True

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Give the lock back, if it was taken."""
        if self._descriptor is not None:
            os.close(self._descriptor)
            self._descriptor = None


def _opened(path: Path) -> int:
    """Return the descriptor of a lock file, which is made where there is none.

    Raises:
        InputError: it cannot be made.

    """
    try:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        return os.open(path, os.O_RDWR | os.O_CREAT, 0o600)
    except OSError as error:
        msg = f"lock file {path} cannot be made: {error.strerror}"
        raise InputError(msg) from error


def already_up(namespace: str, domain: str, who: str) -> str:
    """Return the line that refuses a second graph in a namespace."""
    return (
        f"a graph is already up in namespace {namespace} of ROS domain {domain} ({who}): "
        "stop it first, or choose another --namespace or ROS_DOMAIN_ID"
    )
