"""Nodes as processes of their own, as `ros2 run` starts them: nobody stops the others when one of them dies."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from typing import TYPE_CHECKING

from graph import environment

if TYPE_CHECKING:
    import signal
    from pathlib import Path


class Processes:
    """Nodes as processes of their own, by the name they are given here."""

    def __init__(self, domain_id: int, folder: Path) -> None:
        self._environment = environment(domain_id)
        self._folder = folder
        self.running: dict[str, subprocess.Popen[bytes]] = {}

    def start(self, name: str, *parameters: str, module: str = "", namespace: str = "/") -> None:
        """Start the node of `module`; none: of the package that is called like it."""
        arguments = ["-r", f"__ns:={namespace}", *(word for each in parameters for word in ("-p", each))]
        with (self._folder / f"{name}.txt").open("ab") as log:
            self.running[name] = subprocess.Popen(
                [sys.executable, "-m", module or f"jammkle_{name}", "--ros-args", *arguments],
                env=self._environment,
                stdout=log,
                stderr=log,
            )

    def send(self, name: str, number: signal.Signals) -> float:
        """Send a signal, and return when, s of the monotonic clock."""
        os.kill(self.running[name].pid, number)
        return time.monotonic()

    def said(self, name: str) -> str:
        """Return what a node has written to its terminal."""
        return (self._folder / f"{name}.txt").read_text()

    def end(self) -> None:
        """Kill what still runs, and print what all have said."""
        for process in self.running.values():
            process.kill()
            process.wait()
        for log in self._folder.glob("*.txt"):
            sys.stdout.write(f"{log.name}:\n{log.read_text()}\n")
