"""Chromium without a display, driven over the DevTools protocol, for tests and pictures of the page."""

from __future__ import annotations

import base64
import itertools
import json
import shutil
import subprocess
import time
import urllib.request
from typing import TYPE_CHECKING, Any

from websockets.sync.client import connect

if TYPE_CHECKING:
    from pathlib import Path

    from typing_extensions import Self

TIMEOUT_S = 60.0
_NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
NO_CHROMIUM = "there is no Chromium here: install it, for example `apt install chromium`"


def chromium() -> str | None:
    """Return the path of Chromium, if it is installed."""
    return next((found for name in _NAMES if (found := shutil.which(name))), None)


class Browser:
    """One page in one browser of its own."""

    def __init__(self, folder: Path, size: tuple[int, int] = (1400, 860)) -> None:
        """Prepare.

        Args:
            folder: Empty, for the browser's profile.
            size: Width and height of the window, pixels.

        """
        self._folder, self._size = folder, size
        self._numbers = itertools.count(1)

    def __enter__(self) -> Self:
        """Start it."""
        path = chromium()
        assert path is not None, NO_CHROMIUM
        width, height = self._size
        options = ("--headless=new", "--no-sandbox", "--remote-debugging-port=0", f"--user-data-dir={self._folder}",
                   "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist", "--mute-audio",
                   "--disable-dev-shm-usage", "--disable-background-networking", "--disable-component-update",
                   "--no-first-run", "--hide-scrollbars", f"--window-size={width},{height}")  # fmt: skip
        # It draws without a graphics card, and shall not take the processor from what it looks at.
        nice = [found, "-n", "19"] if (found := shutil.which("nice")) else []
        self._process = subprocess.Popen(
            [*nice, path, *options, "about:blank"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        port_file = self._folder / "DevToolsActivePort"
        wait_until(lambda: port_file.is_file() and "\n" in port_file.read_text(), "Chromium listens")
        port = port_file.read_text().split("\n")[0]
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/json/list") as answer:
            pages = [page for page in json.load(answer) if page["type"] == "page"]
        self._line = connect(pages[0]["webSocketDebuggerUrl"], max_size=None)
        self._line.__enter__()
        self.send("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
        return self

    def __exit__(self, *_error: object) -> None:
        """End it."""
        self._line.close()
        self._process.terminate()
        self._process.wait()

    def send(self, method: str, **parameters: Any) -> Any:
        """Send a command of the protocol and return its result."""
        number = next(self._numbers)
        self._line.send(json.dumps({"id": number, "method": method, "params": parameters}))
        while True:
            message = json.loads(self._line.recv(timeout=TIMEOUT_S))
            if message.get("id") == number:
                assert "error" not in message, message
                return message["result"]

    def open(self, address: str) -> None:
        """Go to an address."""
        self.send("Page.navigate", url=address)

    def value(self, expression: str) -> Any:
        """Return what a JavaScript expression is in the page."""
        result = self.send("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in result, result["exceptionDetails"]
        return result["result"].get("value")

    def text(self) -> str:
        """Return all text that the page shows."""
        return str(self.value("document.body ? document.body.innerText : ''"))

    def wait_for_text(self, text: str) -> None:
        """Wait until the page shows a text."""
        wait_until(lambda: text in self.text(), f"the page says '{text}'", self.text)

    def click(self, label: str, beside: str = "") -> None:
        """Click a button of this label, with the mouse.

        Args:
            label: Its text.
            beside: Text that the right one is nearest to; empty: any.

        """
        expression = f"""(() => {{
            const buttons = [...document.querySelectorAll("button, label")].filter(
                each => each.innerText.trim() === {json.dumps(label)});
            const steps = button => {{
                let up = button, count = 0;
                while (up && !up.innerText.includes({json.dumps(beside)})) {{ up = up.parentElement; count++; }}
                return up ? count : Infinity;
            }};
            const found = buttons.sort((one, other) => steps(one) - steps(other))[0];
            if (!found || steps(found) === Infinity) return null;
            found.scrollIntoView({{block: "center"}});
            const box = found.getBoundingClientRect();
            return [box.x + box.width / 2, box.y + box.height / 2];
        }})()"""
        place = wait_until(lambda: self.value(expression), f"there is a button '{label}' beside '{beside}'", self.text)
        x, y = place
        for kind in ("mouseMoved", "mousePressed", "mouseReleased"):
            self.send("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)

    def field(self, label: str) -> str | None:
        """Return what stands in the first field of this label; None where there is none."""
        found = self.value(f"{_field(label)}?.value ?? null")
        return None if found is None else str(found)

    def type_into(self, label: str, text: str) -> None:
        """Replace what stands in the first field of this label, and press Enter."""
        focus = f"(field => {{ field?.focus(); field?.select(); return !!field; }})({_field(label)})"
        wait_until(lambda: self.value(focus), f"there is a field '{label}'", self.text)
        self.send("Input.insertText", text=text)
        for kind in ("keyDown", "keyUp"):
            self.send("Input.dispatchKeyEvent", type=kind, key="Enter", code="Enter", windowsVirtualKeyCode=13)

    def picture(self) -> bytes:
        """Return what it shows, as PNG."""
        return base64.b64decode(self.send("Page.captureScreenshot", format="png")["data"])


def _field(label: str) -> str:
    """Return an expression for the field that stands beside a label."""
    return f"""(() => {{
        const name = [...document.querySelectorAll("label")].find(
            each => each.innerText.trim() === {json.dumps(label)});
        for (let up = name, i = 0; up && i < 4; up = up.parentElement, i++) {{
            const field = up.querySelector("input:not([type=hidden]):not([type=range])");
            if (field) return field;
        }}
        return null;
    }})()"""


def wait_until(holds: Any, what: str, more: Any = None) -> Any:
    """Wait until something holds, and return it; fail with what was awaited if it never does."""
    end_s = time.monotonic() + TIMEOUT_S
    while not (found := holds()):
        if time.monotonic() > end_s:
            msg = f"gave up waiting until {what}; there is: {more() if more else ''}"
            raise AssertionError(msg)
        time.sleep(0.05)
    return found
