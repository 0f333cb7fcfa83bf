"""`jammkle plot`: what is in the picture of a run, and that no peak is lost in it."""

from __future__ import annotations

import itertools
import math
import subprocess
import sys
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jammkle_bringup.core.run_plot import STRETCHES, Envelope, Loop, Pressure, run_picture
from jammkle_common.command.main import main
from jammkle_view.core.figure import EVENT_TINTS, LINE_TINTS
from jammkle_view.core.samples import EventKind

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from jammkle_bringup.core.run_plot import RunPicture


PLOT_ON_A_FULL_DISK = """
import resource, sys
from jammkle_common.command.main import main
resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, resource.RLIM_INFINITY))
sys.exit(main(sys.argv[1:]))
"""


@given(st.lists(st.tuples(st.floats(0.0, 1e4), st.floats(-1e6, 1e6), st.floats(-1e6, 1e6)), min_size=1, max_size=300))
def test_an_envelope_keeps_the_extremes(points: list[tuple[float, float, float]]) -> None:
    """Whatever comes in whatever order: the extremes of every coordinate are there, and all that is there came."""
    envelope = Envelope(2)
    for point in points:
        envelope.add(*point)
    kept = envelope.points()
    for axis in (1, 2):
        for extreme in (min, max):
            assert extreme(point[axis] for point in kept) == extreme(point[axis] for point in points)
    assert set(kept) <= set(points)


def test_an_envelope_does_not_grow() -> None:
    """Of a million milliseconds no more than a fixed number of points is kept, and the one peak among them."""
    envelope = Envelope()
    for step in range(200_000):
        envelope.add(step * 5e-3, 7.0 if step == 123_456 else 0.001 * (step % 10))
    assert len(envelope.points()) <= 4 * STRETCHES
    assert (123_456 * 5e-3, 7.0) in envelope.points()


@pytest.mark.parametrize("lost", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("step_s", [1e-6, 0.1], ids=["in one stretch", "merged"])
def test_a_reading_that_is_none_hides_no_peak(lost: float, step_s: float) -> None:
    """Whether a stretch begins with it or is merged with one that does; where all are none, there is a gap."""
    envelope = Envelope()
    values = [lost, 9.8, 500.0, -500.0, *[9.8] * 10_000]
    for place, value in enumerate(values):
        envelope.add(place * step_s, value)
    kept = {value for _, value in envelope.points()}
    assert {500.0, -500.0} <= kept
    gap = Envelope()
    for place in range(10_000):
        gap.add(place * step_s, lost)
    assert not any(math.isfinite(value) for _, value in gap.points())


def test_a_reading_that_is_none_does_no_work() -> None:
    """The label of the loop has the work of all others."""
    loop = Loop()
    for time_s, length_m, force_n in ((0.0, 0.0, 10.0), (1.0, math.nan, 10.0), (2.0, 0.1, math.nan), (3.0, 0.2, 10.0)):
        loop.add(time_s, length_m, force_n)
    assert loop.work_j == pytest.approx(2.0)


@pytest.fixture
def bag(bag_maker: Callable[[str], Any]) -> Path:
    """Make a bag of a second: a channel that is jammed, a pull of one tendon round a rectangle, an impact."""
    maker = bag_maker("bag")
    loop = [(0.0, 0.0), (0.01, 0.0), (0.01, 20.0), (0.0, 20.0), (0.0, 0.0)]
    for step in range(101):
        time_s = 5.0 + step * 0.01
        vacuum_pa = 0.0 if step < 30 else 5e4
        maker.write("/achilles/solenoid", time_s, maker.make("std_msgs/msg/Bool", step >= 30))
        if step in {30, 80}:
            maker.write("/pump/duty", time_s, maker.make("std_msgs/msg/Float32", 1.0 if step == 30 else 0.0))
        for channel in ("achilles", "peroneal_left"):
            maker.write(f"/{channel}/pressure", time_s, maker.pressure(time_s, 101_000.0 - vacuum_pa))
        if step % 25 == 0:
            tendon = maker.make(
                "jammkle_msgs/msg/TendonState", "achilles_left", 1, loop[step // 25][0], 0.0, loop[step // 25][1]
            )
            maker.write(
                "/tendon_states", time_s, maker.make("jammkle_msgs/msg/TendonStates", maker.header(time_s), [tendon])
            )
        if step in {0, 30, 60}:
            word = {0: 1, 30: 2, 60: 3}[step]
            maker.write("/jam_state", time_s, maker.jam_state(time_s, word, vacuum_pa, "achilles"))
    maker.write("/contact_events", 6.0, maker.impact(5.25))
    return maker.close()


@pytest.fixture
def picture(bag: Path) -> RunPicture:
    return run_picture(bag, None, lambda _: None, lambda: False)


def test_the_picture_tells_what_happened(picture: RunPicture) -> None:
    """Vacuum from the sensor's own zero, states from when to when, the event at its stamp, the loop and its work."""
    vacuum, state, _, tension = picture.panels
    curves = {curve.name: {round(x, 6): y for x, y in zip(curve.x, curve.y, strict=True)} for curve in vacuum.traces}
    assert curves["achilles"][0.2] == pytest.approx(0.0)
    assert curves["achilles"][0.9] == pytest.approx(50.0)
    assert max(curves["achilles, set point"].values()) == 50.0
    assert [(bar.name, round(bar.base[0], 6), round(bar.base[0] + bar.x[0], 6)) for bar in state.traces] == [
        ("UNJAMMED", 0.0, 0.3),
        ("JAMMING", 0.3, 0.6),
        ("JAMMED", 0.6, 1.0),
    ]
    assert {channel for bar in state.traces for channel in bar.y} == {"achilles"}
    assert [(name, round(time_s, 6)) for time_s, name in picture.marks] == [("IMPACT", 0.25)]
    assert tension.with_marks
    assert picture.loops is not None
    (curve,) = picture.loops.traces
    assert curve.name == "achilles_left: -0.2 J taken up"
    assert list(zip(curve.x, curve.y, strict=True)) == [(0, 0), (10, 0), (10, 20), (0, 20), (0, 0)]


def test_duty_holds_until_the_next_message(picture: RunPicture) -> None:
    """A duty that comes on change is drawn as steps, and goes on to the end of the run."""
    (duty,) = next(panel for panel in picture.panels if panel.y_label == "pump duty").traces
    assert duty.line.shape == "hv"
    assert [(round(x, 6), y) for x, y in zip(duty.x, duty.y, strict=True)] == [(0.3, 1.0), (0.8, 0.0), (1.0, 0.0)]


def test_no_curve_hides_another(picture: RunPicture) -> None:
    """Of curves that may be equal the one that is drawn later is thinner, so that the earlier is seen around it."""
    measured = [curve.name for curve in picture.panels[0].traces if curve.line.dash == "solid"]
    assert measured == ["peroneal_left", "achilles"]
    for panel in picture.panels:
        for dash in ("solid", "dot"):
            widths = [curve.line.width for curve in panel.traces if curve.type == "scatter" and curve.line.dash == dash]
            assert all(later < earlier for earlier, later in itertools.pairwise(widths))


def test_a_channel_and_an_event_have_one_colour_everywhere(bag: Path, picture: RunPicture, tmp_path: Path) -> None:
    """Curves and marks are coloured as on the page in the browser."""
    drawn = {each.name: each.line.color for panel in picture.panels for each in panel.traces if each.type == "scatter"}
    for name in ("achilles", "peroneal_left", "achilles_left"):
        assert bytes.fromhex(drawn[name][1:]) == bytes(LINE_TINTS[name])
    assert main(["plot", str(bag), "-o", str(tmp_path / "out")]) == 0
    impact = bytes(EVENT_TINTS[EventKind.IMPACT]).hex()
    assert f'"color":"#{impact}","width":1' in (tmp_path / "out" / "run.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("command", "ambient_pa"),
    [((False, True), 97.0e3), ((True,), 101325.0), ((), 97.1e3)],
    ids=["vented first", "evacuated from the start", "without commands"],
)
def test_vacuum_is_counted_from_what_the_sensor_reads_at_ambient(command: tuple[bool, ...], ambient_pa: float) -> None:
    """Its mean while vented; of a bag without commands the mean of a whole cycle would be half evacuated."""
    pressure = Pressure()
    for evacuate in command[:1]:
        pressure.command(evacuate=evacuate)
    for step, reading_pa in enumerate((96.9e3, 97.1e3)):
        pressure.add(0.1 * step, reading_pa)
    for evacuate in command[1:]:
        pressure.command(evacuate=evacuate)
    pressure.add(0.2, 50e3)
    assert pressure.ambient_pa == pytest.approx(ambient_pa)


def test_pictures_are_not_overwritten(bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """As `export`: what is there stays, and the line says so; other files of the folder are no hindrance."""
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "notes.txt").write_text("mine", encoding="utf-8")
    call = ["plot", str(bag), "-o", str(tmp_path / "out")]
    assert main(call) == 0
    before = (tmp_path / "out" / "run.html").stat().st_mtime_ns
    capsys.readouterr()
    assert main(call) == 2
    assert "holds run.html: nothing is overwritten" in capsys.readouterr().err
    assert (tmp_path / "out" / "run.html").stat().st_mtime_ns == before


def test_a_page_without_a_panel_is_not_written(
    bag_maker: Callable[[str], Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A robot's joints alone are drawn nowhere: the line says what is, and how the rest is read."""
    maker = bag_maker("joints")
    joints = (["ankle_pitch"], *(np.array([value]) for value in (0.1, 0.0, 0.0)))
    maker.write("/joint_states", 1.0, maker.make("sensor_msgs/msg/JointState", maker.header(1.0), *joints))
    assert main(["plot", str(maker.close()), "-o", str(tmp_path / "out")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "holds nothing in namespace / that is drawn, such as imu/data" in line
    assert "jammkle export" in line
    assert not (tmp_path / "out").exists()


def test_the_page_needs_no_network(bag: Path, tmp_path: Path) -> None:
    """It loads nothing from elsewhere."""
    assert main(["plot", str(bag), "-o", str(tmp_path / "out")]) == 0
    page = (tmp_path / "out" / "run.html").read_text(encoding="utf-8")
    assert "src=" not in page.replace("src='data:", "").partition("<body>")[0]
    assert 'src="http' not in page
    assert "set point" in page


@pytest.mark.parametrize("is_there", [False, True])
def test_a_full_disk_leaves_no_torn_page(bag: Path, tmp_path: Path, *, is_there: bool) -> None:
    """One line; nothing is in the way of the repeat, and what was there before still is."""
    output = tmp_path / "plot"
    if is_there:
        output.mkdir()
        (output / "notes.txt").write_text("mine")
    command = [sys.executable, "-c", PLOT_ON_A_FULL_DISK, "plot", str(bag), "-o", str(output)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1] == f"jammkle: the page cannot be written into {output}: File too large"
    assert [file.name for file in output.glob("*")] == (["notes.txt"] if is_there else [])
    assert output.exists() == is_there
    assert main(["plot", str(bag), "-o", str(output)]) == 0
