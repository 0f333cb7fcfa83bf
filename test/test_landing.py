"""The whole landing over real DDS, as `jammkle demo` runs it, and the bag it leaves."""

from __future__ import annotations

import itertools
import json
import re
import subprocess
import sys
from html import unescape
from typing import TYPE_CHECKING, Any

import pytest
import yaml

from domains import own_domain
from graph import Up
from jammkle_common.names import (
    CHANNELS,
    CLOCK,
    FROM_OUTSIDE,
    IMU,
    JOINT_STATES,
    SIM_PARAMETERS,
    SIMULATOR_GAP,
    TOPICS,
)
from jammkle_gap import Verdict
from jammkle_gap.report.words import VERDICTS

if TYPE_CHECKING:
    from collections.abc import Iterator

pytestmark = pytest.mark.timeout(900)
FALL_HEIGHT_M = 0.05
GRAVITY_M_S2 = 9.80665
FREE_FALL_S = (2.0 * FALL_HEIGHT_M / GRAVITY_M_S2) ** 0.5
RELEASE_S = 1.0
HELD_PA = 40e3
"""What the controller asks for in a stance by default."""
EFFECT = "line_leak_achilles"
"""What is wrong with the ankle that lands. Not a lost fibre: one landing hardly tells it from a failed tendon."""
DEMO_TIMEOUT_S = 800.0
"""The first demo on a machine simulates all signatures; on a busy one that takes minutes."""
LOAD_CELL_PERIOD_S = 0.002
LONGEST_DETECTION_S = 0.010
"""Five samples of the IMU at 500 Hz: beyond that the shock is half over."""

READ_WITHOUT_THIS_PROJECT = """
import json, sys
from pathlib import Path

class Blocker:
    def find_spec(self, name, path=None, target=None):
        if name.startswith("jammkle") or name == "rclpy":
            raise ImportError(name + " is blocked")
        return None

sys.meta_path.insert(0, Blocker())
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

bag = Path(sys.argv[1])
found = {"rosbags": {}, "mcap": 0, "stamps": {}}
with AnyReader([bag]) as reader:
    for connection, log_ns, raw in reader.messages():
        message = reader.deserialize(raw, connection.msgtype)
        found["rosbags"].setdefault(connection.topic, 0)
        found["rosbags"][connection.topic] += 1
        if hasattr(message, "header"):
            stamp_ns = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
            found["stamps"].setdefault(connection.topic, []).append(stamp_ns * 1e-9)
for path in bag.glob("*.mcap"):
    with path.open("rb") as file:
        found["mcap"] += sum(1 for _ in make_reader(file).iter_messages())
print(json.dumps(found))
"""


@pytest.fixture(scope="module")
def landing(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Any]]:
    """Run the demo once; hand over its exit code, what it printed, its JSON and its folder."""
    folder = tmp_path_factory.mktemp("demo")
    with own_domain() as domain_id:
        output = ("-o", str(folder / "runs"), "--json", str(folder / "demo.json"))
        demo = Up(domain_id, folder, "demo", "--effect", EFFECT, *output)
        code = demo.wait(DEMO_TIMEOUT_S)
        assert code == 0, demo.text()
        result = json.loads((folder / "demo.json").read_text())
        (run,) = (folder / "runs").iterdir()
        yield {"text": demo.text(), "run": run, **result}


@pytest.fixture(scope="module")
def bag(landing: dict[str, Any]) -> dict[str, Any]:
    """What rosbags and mcap read from the demo's bag in a process that cannot import this project."""
    result = subprocess.run(
        [sys.executable, "-c", READ_WITHOUT_THIS_PROJECT, str(landing["run"] / "bag")],
        capture_output=True,
        text=True,
        check=True,
        cwd="/",
    )
    return dict(json.loads(result.stdout))


def test_the_foot_touches_down_after_a_free_fall(landing: dict[str, Any], bag: dict[str, Any]) -> None:
    """From the release to touch-down it takes sqrt(2 h / g), to three samples of the load cell."""
    begin_s = min(bag["stamps"][f"/{IMU.name}"])
    touch_down_s = landing["touch_down_s"] + begin_s
    assert touch_down_s == pytest.approx(RELEASE_S + FREE_FALL_S, abs=3 * LOAD_CELL_PERIOD_S + 0.5 * begin_s)


def test_the_impact_is_felt_in_time(landing: dict[str, Any]) -> None:
    """The controller detects the impact within five IMU samples of the load cell's touch-down, and not before it."""
    late_s = landing["detected_s"] - landing["touch_down_s"]
    assert -LOAD_CELL_PERIOD_S <= late_s <= LONGEST_DETECTION_S


def test_every_channel_is_jammed_after_the_impact(landing: dict[str, Any]) -> None:
    """Each solenoid is energised after the detection, and each channel then reaches its vacuum."""
    assert {channel["channel"] for channel in landing["channels"]} == set(CHANNELS)
    for channel in landing["channels"]:
        assert channel["energised_s"] >= landing["detected_s"]
        assert channel["reached_s"] > channel["energised_s"]
        assert channel["commanded_vacuum_pa"] == pytest.approx(HELD_PA)


def test_the_demo_leaves_a_table_and_a_picture(landing: dict[str, Any]) -> None:
    """What it prints names touch-down, detection, channels, peak and bag; the picture is a PNG of some size."""
    for word in ("touch-down", "detected", "peak", "bag", *CHANNELS):
        assert word in landing["text"]
    assert "Traceback" not in landing["text"]
    (picture,) = landing["run"].glob("*.png")
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert picture.stat().st_size > 10_000


def test_the_demo_leaves_the_page_of_its_gap(landing: dict[str, Any]) -> None:
    """`gap.html` says what was printed and how to make it again, stands in the run's folder, and is named last."""
    last = re.search(r"^in truth: .*\npage: (.*)$", landing["text"], re.MULTILINE)
    assert last
    assert last[1] == landing["page"]
    page = landing["run"] / "gap.html"
    assert page.samefile(landing["page"])
    said = " ".join(unescape(re.sub(r"<[^>]+>", " ", page.read_text(encoding="utf-8"))).split())
    assert VERDICTS[Verdict(landing["diagnosis"]["verdict"])].upper() in said
    assert f"jammkle demo --effect {EFFECT}" in said
    corrected = yaml.safe_load((landing["run"] / "corrected.yaml").read_text(encoding="utf-8"))
    assert (corrected is not None) == (landing["diagnosis"]["verdict"] in {"EFFECTS", "AMBIGUOUS"})


def test_the_demo_finds_what_it_was_not_told(landing: dict[str, Any]) -> None:
    """The diagnosis has the effect in its credible set and closes the gap; the truth comes after the verdict alone."""
    assert landing["diagnosis_outcome"] in {"right", "among several"}
    named = {name for each in landing["diagnosis"]["set"] for name in (*each["names"], *each["equivalents"])}
    assert EFFECT in named
    gap = landing["diagnosis"]["gap"]
    # How large the gap is hangs on the size that was drawn.
    assert gap["corrected"] < gap["nominal"]
    assert gap["closed"] > 0.5
    before, _, after = landing["text"].partition("in truth: ")
    assert f"verdict: {VERDICTS[Verdict(landing['diagnosis']['verdict'])]}." in before
    assert EFFECT in after
    assert "first answer, before any fit" in landing["text"]


def test_the_bag_is_complete_and_opens_without_this_project(bag: dict[str, Any]) -> None:
    """Every topic of the graph is in it, and rosbags and mcap count the same messages."""
    expected = {topic.name if topic.name.startswith("/") else f"/{topic.name}" for topic in TOPICS}
    optional = {f"/{topic.name}" for topic in (SIMULATOR_GAP, *FROM_OUTSIDE)}
    assert expected - optional <= set(bag["rosbags"])
    assert bag["mcap"] == sum(bag["rosbags"].values())
    assert bag["rosbags"][f"/{SIM_PARAMETERS.name}"] == 1


def test_no_sample_is_lost(bag: dict[str, Any]) -> None:
    """IMU and joint states are 2 ms apart from the first to the last, and /clock ticks for each."""
    for topic in (IMU, JOINT_STATES):
        stamps = sorted(bag["stamps"][f"/{topic.name}"])
        gaps = [round((later - earlier) * 1e3) for earlier, later in itertools.pairwise(stamps)]
        assert set(gaps) == {2}, f"{topic.name}: {[gap for gap in gaps if gap != 2]} ms"
    assert bag["rosbags"][CLOCK.name] >= 0.9 * bag["rosbags"][f"/{IMU.name}"]


def test_metadata_is_that_of_rosbag2(landing: dict[str, Any]) -> None:
    """metadata.yaml has version 9 and MCAP storage, as Jazzy writes it."""
    text = (landing["run"] / "bag" / "metadata.yaml").read_text()
    assert "version: 9" in text
    assert "storage_identifier: mcap" in text
    assert "transient_local" in text
