"""The page of a recording, from a browser's end of the line: scrubbed, played, with its simulation beside it."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from page_client import PageClient

from browser import wait_until

if TYPE_CHECKING:
    from collections.abc import Callable

    from graph import Up

JAMMKLE = Path(sys.executable).with_name("jammkle")
LATE_S = 3.0
"""The ankle has fallen by then, and lies."""


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A landing of an ankle that has lost fibres, and beside it what the simulation lacks."""
    folder = tmp_path_factory.mktemp("playback")
    (folder / "lost.yaml").write_text("fibre_loss_achilles_left: {lost: 0.8}\n")
    rig = [JAMMKLE, "rig", "landing", "--effects", "lost.yaml", "-o", "landing"]
    subprocess.run(rig, check=True, capture_output=True, cwd=folder)
    return folder / "landing"


def test_a_recording_is_scrubbed_and_played(start: Callable[..., Up], bag: Path) -> None:
    """The slider moves the robot and its simulation; Play goes on from there; the gap is written beside them."""
    with PageClient(page_of(start("view", str(bag)))) as page:
        page.wait_until(lambda: "/simulated/carriage" in page.positions_m, "recording and simulation are drawn")
        held_m = height_m(page, "recorded")
        page.change("time [s]", LATE_S)
        page.wait_until(lambda: height_m(page, "recorded") < held_m - 0.04, "the recorded ankle has fallen")
        page.wait_until(lambda: height_m(page, "simulated") < held_m - 0.04, "so has the simulated one")
        assert apart_m(page) > 0.005  # the ankle that has lost fibres gives way further
        assert "achilles_left/tension" in page.text()

        page.change("time [s]", 0.0)
        page.wait_until(lambda: abs(height_m(page, "recorded") - held_m) < 1e-3, "it is held again")
        page.change("speed", "2")
        page.change("playback", "Play")
        page.wait_until(lambda: height_m(page, "recorded") < held_m - 0.04, "it falls again by itself")
        page.change("playback", "Pause")
        page.change("show simulation", value=False)
        page.wait_until(lambda: page.visible.get("/simulated") is False, "the simulation is out of sight")


def test_corrected_the_two_lie_on_each_other(start: Callable[..., Up], bag: Path) -> None:
    """With the effect that the recorded ankle had, the simulation ends where the recording does."""
    view = start("view", str(bag), "--corrected", str(bag.parent / "lost.yaml"))
    with PageClient(page_of(view)) as page:
        page.wait_until(lambda: "/simulated/carriage" in page.positions_m, "recording and simulation are drawn")
        held_m = height_m(page, "recorded")
        page.change("time [s]", LATE_S)
        page.wait_until(lambda: height_m(page, "recorded") < held_m - 0.04, "the recorded ankle has fallen")
        page.wait_until(lambda: apart_m(page) < 0.001, "the simulated one lies beside it")


def page_of(view: Up) -> str:
    """Address of the page, once it is there."""
    wait_until(lambda: "page: " in view.text(), "there is a page", view.text)
    return re.findall(r"page: (http://localhost:\d+)", view.text())[0]


def height_m(page: PageClient, who: str) -> float:
    return page.positions_m[f"/{who}/carriage"][2]


def apart_m(page: PageClient) -> float:
    """Height of the recorded carriage beside the simulated one."""
    return abs(height_m(page, "recorded") - height_m(page, "simulated"))
