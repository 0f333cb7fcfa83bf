"""`make pictures`: the pictures of the page in docs/images, taken in Chromium without a display."""

from __future__ import annotations

import io
import re
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING

from PIL import Image

from browser import NO_CHROMIUM, Browser, chromium, wait_until
from domains import own_domain
from graph import Up
from readme_tables import DOCS

if TYPE_CHECKING:
    from collections.abc import Callable

PATIENT = """
/**/driver: {ros__parameters: {pressure_timeout_s: 10.0}}
/**/sim: {ros__parameters: {speed: 0.5}}
/**/viewer: {ros__parameters: {frame_rate_hz: 8.0}}
"""
"""A machine that draws without a graphics card is too busy to simulate in real time."""
WEAKENED = "fibre_loss_achilles_left: {lost: 0.8}\n"
"""What is wrong with the ankle whose recording is shown, so that there is a gap to be seen."""
LEAK = "line_leak_achilles: {conductance_dm3_s_bar: 0.003}\n"
"""What is wrong with the ankle that is diagnosed."""
DIAGNOSED_S = 600.0
"""Until a diagnosis is done, on a busy machine too."""
SLOW_S = 3.0
"""Until what was changed is drawn; nothing of the page tells."""
COLOURS = 256


def keep(browser: Browser, name: str) -> None:
    """Keep what a browser shows as a picture of the pages."""
    picture = Image.open(io.BytesIO(browser.picture())).convert("RGB").quantize(COLOURS)
    picture.save(DOCS / "images" / f"{name}.png", optimize=True)


def take(name: str, arguments: tuple[str, ...], prepare: Callable[[Browser], None], folder: Path) -> None:
    """Open the page of a command, make it ready, and keep what it shows."""
    with own_domain() as domain_id:
        shown = Up(domain_id, folder, *arguments)
        try:
            pages = wait_until(lambda: re.findall(r"page: (http://\S+?);?\s", shown.text()), "a page", shown.text)
            with Browser(folder / name, (1400, 860)) as browser:
                browser.open(pages[0])
                browser.wait_for_text("time")
                time.sleep(SLOW_S)
                browser.value(  # says that there is no graphics card
                    "document.querySelectorAll('[class*=Notification] button').forEach(each => each.click())"
                )
                prepare(browser)
                time.sleep(SLOW_S)
                keep(browser, name)
        finally:
            shown.stop()


def first_screen_of_a_gap(folder: Path) -> None:
    """Diagnose a leak, and keep what the page shows before anybody scrolls."""
    (folder / "leak.yaml").write_text(LEAK)
    calls = (
        ("rig", "pressure", "--effects", "leak.yaml", "--seed", "3", "-o", "leaking"),
        ("gap", "diagnose", "leaking", "-o", "gap"),
    )
    with own_domain() as domain_id:
        for call in calls:
            if Up(domain_id, folder, *call).wait(DIAGNOSED_S) != 0:
                msg = f"jammkle {' '.join(call)} failed"
                raise RuntimeError(msg)
    with Browser(folder / "browser", (1280, 700)) as browser:
        browser.open((folder / "gap" / "gap.html").as_uri())
        browser.wait_for_text("How far".upper())
        keep(browser, "gap")


def after_a_landing(browser: Browser) -> None:
    """Let the ankle fall once more while somebody looks."""
    browser.wait_for_text("SETTLED")
    felt = browser.text().count("SETTLED")
    browser.click("Reset")
    wait_until(lambda: browser.text().count("SETTLED") > felt, "it has landed again", browser.text)


def at_the_shock(browser: Browser) -> None:
    """Stand where recording and simulation are apart."""
    browser.type_into("time [s]", "1.155")


def main() -> int:
    """Take all pictures."""
    if chromium() is None:
        sys.stderr.write(f"{NO_CHROMIUM}\n")
        return 1
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as name:
        folder = Path(name)
        (folder / "patient.yaml").write_text(PATIENT)
        (folder / "weakened.yaml").write_text(WEAKENED)
        with own_domain() as domain_id:
            rig = ("rig", "landing", "--effects", "weakened.yaml", "-o", "landing")
            if Up(domain_id, folder, *rig).wait() != 0:
                return 1
        first_screen_of_a_gap(folder)
        take("view", ("up", "--view", "--params", "patient.yaml"), after_a_landing, folder)
        take("view_bag", ("view", "landing"), at_the_shock, folder)
    return 0


if __name__ == "__main__":
    sys.exit(main())
