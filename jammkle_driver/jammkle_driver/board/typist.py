"""The person at the terminal, whose answers are read while the board is talked to."""

from __future__ import annotations

import asyncio
import math
import os
import select
import sys
from typing import TYPE_CHECKING

import typer

from jammkle_common.command.errors import Interrupted

if TYPE_CHECKING:
    from jammkle_driver.board.check import CheckRow

_LOOK_S = 0.02
"""How often is looked for what was typed, s. Assumed: nobody notices it."""

_MOST_BYTES = 4096
"""Longest line of a terminal (N_TTY in Linux)."""

_ANSWERS = {"": True, "y": True, "yes": True, "n": False, "no": False}


class Typist:
    """Who sits at the terminal.

    A line is read when it is there: a thread that waited for it would hold up the end, and that end stops a pump.
    """

    def __init__(self) -> None:
        """Begin with nothing typed."""
        self._typed = b""

    def told(self, row: CheckRow) -> None:
        """Show a row as soon as it is known."""
        typer.echo(f"{'ok  ' if row.passed else 'FAIL'} {row.what}: {row.measured}", err=True)

    async def agrees(self, question: str) -> bool:
        """Ask until yes or no is typed; nothing is yes.

        Raises:
            Interrupted: nobody is there to answer.

        """
        while (answer := (await self._answer(f"{question} [Y/n]: ")).lower()) not in _ANSWERS:
            typer.echo(f"'{answer}' is neither y nor n", err=True)
        return _ANSWERS[answer]

    async def number(self, question: str, least: float, most: float) -> float | None:
        """Ask until a number that can be right, or nothing, is typed.

        Raises:
            Interrupted: nobody is there to answer.

        """
        while answer := await self._answer(f"{question}; nothing: skip: "):
            try:
                number = float(answer.replace(",", "."))
            except ValueError:
                number = math.nan
            if least <= number <= most:
                return number
            if math.isfinite(number):
                typer.echo(f"{answer} cannot be: {least:g} to {most:g} is asked for", err=True)
            else:
                typer.echo(f"'{answer}' is not a number", err=True)
        return None

    async def _answer(self, question: str) -> str:
        typer.echo(question, nl=False, err=True)
        try:
            return await self._line()
        except (Interrupted, asyncio.CancelledError):
            typer.echo(err=True)  # what is said next gets a line of its own
            raise

    async def _line(self) -> str:
        if sys.stdin is None:
            raise Interrupted
        while b"\n" not in self._typed:
            if not select.select([sys.stdin], [], [], 0.0)[0]:
                await asyncio.sleep(_LOOK_S)
                continue
            try:
                came = os.read(sys.stdin.fileno(), _MOST_BYTES)
            except OSError:  # the terminal was closed
                came = b""
            if not came and not self._typed:
                raise Interrupted
            self._typed += came or b"\n"
        line, _, self._typed = self._typed.partition(b"\n")
        return line.decode(errors="replace").strip()
