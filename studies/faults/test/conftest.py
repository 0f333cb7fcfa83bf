"""The board's firmware, for the soak on it."""

from __future__ import annotations

import pytest

from boards import board_command


@pytest.fixture(scope="session")
def command(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Build the board's firmware; return what runs it."""
    return board_command(tmp_path_factory.mktemp("firmware"))
