"""`jammkle export`: what stands in the tables of a bag, and that their making takes no more memory for a longer one."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow.parquet
import pytest

from jammkle_bringup.core import export as export_module
from jammkle_common.command.main import main

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

PEAK_MB = """
import resource, sys
from jammkle_common.command.main import main
assert main(sys.argv[1:]) == 0
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
"""


def peak_mb(*arguments: str) -> float:
    """Most memory that the command holds, MB."""
    script = [sys.executable, "-c", PEAK_MB, *arguments]
    return float(subprocess.run(script, check=True, capture_output=True, text=True).stdout.splitlines()[-1])


def table(path: Path) -> list[dict[str, str]]:
    """Rows of a CSV file."""
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def imu(maker: Any, time_s: float, upward: float) -> Any:
    """IMU without an orientation."""
    none, zero = np.array([-1.0, *[0.0] * 8]), np.zeros(9)
    vector = [maker.make("geometry_msgs/msg/Vector3", *each) for each in ((0.1, 0.2, 0.3), (0.0, 0.0, upward))]
    nowhere = maker.make("geometry_msgs/msg/Quaternion", 0.0, 0.0, 0.0, 1.0)
    return maker.make("sensor_msgs/msg/Imu", maker.header(time_s), nowhere, none, vector[0], zero, vector[1], zero)


def joints(maker: Any, time_s: float, names: list[str]) -> Any:
    """Joint states with positions alone."""
    numbers = np.arange(len(names)) * 0.5 + time_s
    return maker.make("sensor_msgs/msg/JointState", maker.header(time_s), names, numbers, np.empty(0), np.empty(0))


@pytest.fixture
def bag(bag_maker: Callable[[str], Any]) -> Path:
    """Make a bag of five seconds: IMU with a hole of two, pressure, joints, tendons, solenoid, state, event."""
    maker = bag_maker("bag")
    for step in range(500):
        time_s = 10.0 + step * 0.01
        if not 200 <= step < 400:
            maker.write("/lf_ankle/imu/data", time_s, imu(maker, time_s, step))
        if step % 2 == 0:
            maker.write("/lf_ankle/achilles/pressure", time_s, maker.pressure(time_s, 1e5 - step))
            maker.write("/lf_ankle/joint_states", time_s, joints(maker, time_s, ["ankle_pitch", "carriage"]))
        if step % 100 == 0:
            maker.write("/lf_ankle/achilles/solenoid", time_s, maker.make("std_msgs/msg/Bool", step >= 100))
            state = maker.jam_state(time_s, step // 100, 5e4, "achilles")
            state.fault.reason = state.channels[0].fault = 7 * (step == 400)
            maker.write("/lf_ankle/jam_state", time_s, state)
    maker.write("/lf_ankle/contact_events", 12.5, maker.impact(12.5))
    maker.write("/robot_description", 10.0, maker.make("std_msgs/msg/String", "<robot name='leg'/>"))
    return maker.close()


def test_each_topic_is_a_table_with_units_in_its_columns(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Values and stamps are those of the messages; words for constants, no variances, no orientation that is none."""
    assert main(["export", str(bag), "-o", str(tmp_path / "out"), "--json", str(tmp_path / "out.json")]) == 0
    assert f"{tmp_path / 'out'}: time_s counts from ROS time 10.000000000 s" in capsys.readouterr().out.splitlines()
    written = json.loads((tmp_path / "out.json").read_text())
    assert written["start_s"] == 10.0
    rows = table(tmp_path / "out" / "lf_ankle_imu_data.csv")
    assert list(rows[0]) == [
        "time_s",
        *(f"angular_velocity_{axis}_rad_s" for axis in "xyz"),
        *(f"linear_acceleration_{axis}_m_s2" for axis in "xyz"),
    ]
    assert len(rows) == 300
    last = rows[-1]
    assert (float(last["time_s"]), float(last["linear_acceleration_z_m_s2"])) == (4.99, 499.0)
    (first, *_) = table(tmp_path / "out" / "lf_ankle_joint_states.csv")
    assert {name: float(value) for name, value in first.items()} == {
        "time_s": 0.0,
        "ankle_pitch_position_rad": 10.0,
        "carriage_position_m": 10.5,
    }
    states = table(tmp_path / "out" / "lf_ankle_jam_state.csv")
    assert [row["achilles_state"] for row in states] == ["UNKNOWN", "UNJAMMED", "JAMMING", "JAMMED", "VENTING"]
    assert {"achilles_commanded_vacuum_pa", "manifold_vacuum_pa", "fault_reason"} <= states[0].keys()
    assert [row["achilles_fault"] for row in states] == ["", "", "", "", "SENSOR_DEAD"]
    assert [row["fault_reason"] for row in states] == ["", "", "", "", "SENSOR_DEAD"]
    (event,) = table(tmp_path / "out" / "lf_ankle_contact_events.csv")
    assert (event["type"], event["magnitude"], event["unit"]) == ("IMPACT", "30", "m/s^2")
    assert [row["solenoid"] for row in table(tmp_path / "out" / "lf_ankle_achilles_solenoid.csv")] == [
        "false",
        *["true"] * 4,
    ]


def test_one_time_base_keeps_what_is_true_between_samples(bag: Path, tmp_path: Path) -> None:
    """Straight lines between readings, the last value of states, nothing in a hole; Parquet holds numbers as such."""
    assert main(["export", str(bag), "-o", str(tmp_path / "out"), "--parquet", "--rate-hz", "400"]) == 0
    run = pyarrow.parquet.read_table(tmp_path / "out" / "run.parquet")
    rows = {round(row["time_s"] * 400): row for row in run.to_pylist()}
    assert len(rows) == 1997
    between = rows[41]  # 0.1025 s: a quarter of the way from 0.10 to 0.11 s, an eighth from 0.10 to 0.12 s
    assert between["lf_ankle_imu_data_linear_acceleration_z_m_s2"] == pytest.approx(10.25)
    assert between["lf_ankle_achilles_pressure_pa"] == pytest.approx(1e5 - 10.25)
    assert between["lf_ankle_joint_states_carriage_position_m"] == pytest.approx(10.6025)
    assert rows[399]["lf_ankle_achilles_solenoid"] is False
    assert rows[400]["lf_ankle_achilles_solenoid"] is True
    assert rows[700]["lf_ankle_jam_state_achilles_state"] == "UNJAMMED"
    assert rows[1000]["lf_ankle_imu_data_linear_acceleration_z_m_s2"] is None
    assert rows[1000]["lf_ankle_achilles_pressure_pa"] == pytest.approx(1e5 - 250.0)
    apart = {"lf_ankle_contact_events.parquet", "robot_description.parquet"}  # of which not every row needs all
    assert {file.name for file in (tmp_path / "out").iterdir()} == {"run.parquet", *apart}


@pytest.mark.parametrize("form", ["--csv", "--parquet"])
def test_a_joint_that_comes_late_has_its_column(
    bag_maker: Callable[[str], Any], tmp_path: Path, form: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Though the table was begun without it: rows before it are empty there, and none is lost or doubled."""
    monkeypatch.setattr(export_module, "PART_ROWS", 4)
    maker = bag_maker("bag")
    for step in range(30):
        names = ["knee"] if step < 20 else ["knee", "hip"]
        maker.write("/joint_states", step * 0.1, joints(maker, step * 0.1, names))
    assert main(["export", str(maker.close()), "-o", str(tmp_path / "out"), form]) == 0
    (file,) = (tmp_path / "out").iterdir()
    if form == "--csv":
        hip = [row["hip_position_rad"] for row in table(file)]
    else:
        hip = [row["hip_position_rad"] or "" for row in pyarrow.parquet.read_table(file).to_pylist()]
    assert [value == "" for value in hip] == [True] * 20 + [False] * 10


def test_a_longer_bag_takes_no_more_memory(bag_maker: Callable[[str], Any], tmp_path: Path) -> None:
    """Export and plot of a bag that is five times as long hold as much at their peak, but for some MB."""
    peaks: dict[str, list[float]] = {"export": [], "plot": []}
    for name, count in (("short", 10_000), ("long", 50_000)):
        maker = bag_maker(name)
        message = imu(maker, 1.0, 9.8)  # one for all, as making them takes most of the time; the log tells them apart
        message.header.stamp.sec = 0
        message.header.stamp.nanosec = 0
        for step in range(count):
            maker.write("/imu/data", 1.0 + step * 1e-3, message)
        path = str(maker.close())
        peaks["plot"].append(peak_mb("plot", path, "-o", str(tmp_path / f"{name}_plot")))
        peaks["export"].append(peak_mb("export", path, "-o", str(tmp_path / f"{name}_tables"), "--parquet"))
    assert peaks["plot"][1] < peaks["plot"][0] + 15.0
    assert peaks["export"][1] < peaks["export"][0] + 15.0


@pytest.mark.parametrize("form", ["csv", "parquet"])
def test_a_text_that_comes_late_is_a_text(
    bag_maker: Callable[[str], Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, form: str
) -> None:
    """A topic that appears once parts are written has its column with the type of its values."""
    monkeypatch.setattr(export_module, "PART_ROWS", 50)
    maker = bag_maker("late")
    for step in range(300):
        maker.write("/level", 1.0 + 0.01 * step, maker.make("std_msgs/msg/Float64", float(step)))
        if step > 250:
            maker.write("/mode", 1.0 + 0.01 * step, maker.make("std_msgs/msg/String", "walk"))
    maker.close()
    assert main(["export", str(maker.path), "-o", str(tmp_path / "out"), "--rate-hz", "100", f"--{form}"]) == 0
    if form == "csv":
        assert table(tmp_path / "out" / "run.csv")[-1]["mode"] == "walk"
    else:
        assert pyarrow.parquet.read_table(tmp_path / "out" / "run.parquet")["mode"].to_pylist()[-1] == "walk"


def test_what_is_no_straight_line_and_no_time_of_ours(bag_maker: Callable[[str], Any], tmp_path: Path) -> None:
    """A phase jumps back at touch-down, a carriage is in metres along both axes, `time_s` of a topic is beside ours."""
    maker = bag_maker("odd")
    for step in range(200):
        time_s = 1.0 + 0.01 * step
        maker.write("/gait/phase", time_s, maker.make("std_msgs/msg/Float32", (0.3 + 0.01 * (step // 4 * 4)) % 1.0))
        maker.write("/joint_states", time_s, joints(maker, time_s, ["carriage_x", "carriage", "ankle_pitch"]))
        maker.write("/clocks/time_s", time_s, maker.make("std_msgs/msg/Float64", 500.0 - step))
    maker.close()
    assert main(["export", str(maker.path), "-o", str(tmp_path / "grid"), "--rate-hz", "1000"]) == 0
    rows = table(tmp_path / "grid" / "run.csv")
    phases = [float(row["gait_phase"]) for row in rows if row["gait_phase"]]
    assert {round(each, 2) for each in phases} <= {round((0.3 + 0.04 * k) % 1.0, 2) for k in range(50)}
    assert {"joint_states_carriage_x_position_m", "joint_states_ankle_pitch_position_rad"} <= rows[0].keys()
    assert main(["export", str(maker.path), "-o", str(tmp_path / "each")]) == 0
    own = table(tmp_path / "each" / "clocks_time_s.csv")
    assert [float(row["time_s"]) for row in own[:3]] == pytest.approx([0.0, 0.01, 0.02])
