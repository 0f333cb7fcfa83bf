"""`jammkle hardware check`: the check finds what is broken, says what to do, and calibrates."""

from __future__ import annotations

import asyncio
import dataclasses
import json
import math
import random
import subprocess
from typing import TYPE_CHECKING

import pytest
import yaml

from board_bench import BoardBench, BoardPlant
from boards import Host, wiring
from graph import COMMAND
from jammkle_common.command.errors import InputError
from jammkle_common.names import CHANNELS
from jammkle_driver.board.check import Probe
from jammkle_driver.board.commissioning import (
    CommissioningOptions,
    _Calibration,
    commission,
    sensor_lines,
    write_board_file,
)
from jammkle_driver.board.protocol import Exchange
from jammkle_driver.board.wiring import load_wiring, standard_board_file
from jammkle_driver.core.hardware import MANIFOLD
from jammkle_sim.physics.pneumatics import PneumaticParameters

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from jammkle_driver.board.check import CheckRow
    from jammkle_driver.board.wiring import Wiring
    from jammkle_driver.core.hardware import ActuatorCommand

HEALTHY = PneumaticParameters()
UV_PER_KPA = 45_000
"""Of a sensor of the MPX4115A class at 5 V (NXP data sheet)."""
PACE = 0.2
"""The simulated plant is quicker than what the check has patience for."""


class Person:
    """Somebody with a barometer and a gauge that are right."""

    def __init__(self, answers: Callable[[str], float | None] = lambda _: None) -> None:
        self._answers = answers

    def reported(self, row: CheckRow) -> None:
        """Be shown a row; nothing to do."""

    async def number(self, question: str, least: float, most: float) -> float | None:  # noqa: ARG002 - right always
        return self._answers(question)


def walked(port: Path, person: Person | None = None) -> dict[str, CheckRow]:
    options = CommissioningOptions(str(port), wiring(), None, None, calibrates=person is not None, pace=PACE)
    return {row.what: row for row in asyncio.run(commission(options, person or Person()))}


def failed(rows: dict[str, CheckRow]) -> set[str]:
    return {what for what, row in rows.items() if not row.passed}


def test_a_healthy_board_passes_twice(command: list[str], tmp_path: Path) -> None:
    """Every row passes, and again on the manifold that the first check has left evacuated; exit 0, JSON, a table."""
    with BoardBench(command, tmp_path / "board") as bench:
        assert not failed(walked(tmp_path / "board"))
        arguments = ["hardware", "check", "--port", str(tmp_path / "board"), "--yes", "--json", str(tmp_path / "rows")]
        result = subprocess.run([COMMAND, *arguments], capture_output=True, text=True, check=False)
        assert result.returncode == 0, result.stdout
        assert "valve achilles vents" in result.stdout
        assert json.loads((tmp_path / "rows").read_text())["passed"]
        assert bench.released


@pytest.mark.parametrize(
    ("plant", "pins", "expected"),
    [
        ({"pump_free_flow_l_min": 1e-6}, {}, {"pump": "does it run"}),
        ({"pump_free_flow_l_min": 0.2}, {}, {"pump": "worn membrane"}),
        ({"leak_conductance_dm3_s_bar": 0.01}, {}, {"leak of manifold": "soapy water"}),
        (
            {},
            {0: 0, 2: 5_000_000, 4: 1_500_000},
            {"sensor peroneal_left at rest": "wire", "sensor achilles at rest": "broken wire", "board": "supply"},
        ),
        ({}, {1: 4_470_000}, {"valve peroneal_right connects": "stuck closed"}),
    ],
)
def test_what_is_broken_fails_and_says_what_to_do(
    command: list[str], tmp_path: Path, plant: dict[str, float], pins: dict[int, int], expected: dict[str, str]
) -> None:
    """Each fault, in the plant or at a pin, fails its own row; what follows a dead pump is not tried."""
    with BoardBench(command, tmp_path / "board", BoardPlant(dataclasses.replace(HEALTHY, **plant))) as bench:
        bench.override_uv.update(pins)
        rows = walked(tmp_path / "board")
    for row, words in expected.items():
        assert row in failed(rows)
        assert words in rows[row].to_do


def stuck_open(bench: BoardBench) -> None:
    """Keep the valve of the Achilles tendons at the manifold, whatever its coil does."""
    drive = bench.plant.drive
    bench.plant.drive = lambda solenoids, duty: drive(solenoids | 0b100, duty)


def exchanged(bench: BoardBench) -> None:
    """Exchange the hoses of the two peroneal tendons behind their valves."""
    drive = bench.plant.drive
    bench.plant.drive = lambda solenoids, duty: drive(
        solenoids & 0b100 | (solenoids & 0b001) << 1 | (solenoids & 0b010) >> 1, duty
    )


def disturbed(bench: BoardBench, pin: int, disturbance_uv: Callable[[], float]) -> None:
    """Add a voltage, uV, to that of a sensor."""
    pins_uv = bench.plant.pins_uv
    bench.plant.pins_uv = lambda: [
        uv + round(disturbance_uv()) if each == pin else uv for each, uv in enumerate(pins_uv())
    ]


AT_ONE_CHANNEL: dict[str, tuple[Callable[[BoardBench], None], dict[str, str]]] = {
    "valve stuck open": (stuck_open, {"valve achilles vents": "stuck open"}),
    "hoses exchanged": (
        exchanged,
        {
            "valve peroneal_left connects": "peroneal_right instead gets vacuum: exchanged",
            "valve peroneal_right connects": "peroneal_left instead gets vacuum: exchanged",
        },
    ),
    "line pinched": (
        lambda bench: bench.plant.air.pinch("peroneal_right", 0.2),
        {"line peroneal_right": "pinched or kinked"},
    ),
    "line all but shut": (
        lambda bench: bench.plant.air.pinch("peroneal_right", 0.06),
        {
            "valve peroneal_right connects": "blocked or kinked line",
            "valve peroneal_right vents": "blocked or kinked line",
        },
    ),
    "sensor off by 5 kPa": (
        lambda bench: disturbed(bench, 1, lambda: -5.0 * UV_PER_KPA),
        {"sensors agree": "calibrate; if that does not help, one sensor is broken"},
    ),
    "wire of a sensor broken": (
        lambda bench: bench.override_uv.update({2: 5_000_000}),
        {
            f"{what} achilles {when}": "broken wire"
            for what, when in (("sensor", "at rest"), ("valve", "connects"), ("valve", "vents"))
        },
    ),
    "wire of the manifold's sensor broken": (
        lambda bench: bench.override_uv.update({3: 5_000_000}),
        {"sensor manifold at rest": "broken wire"},
    ),
    "membrane torn": (
        lambda bench: bench.plant.air.puncture("peroneal_left", 0.02),
        {"leak of peroneal_left": "soapy water"},
    ),
}
"""What is wrong with one channel, and the rows that fail by it, with words of what to do."""


@pytest.mark.parametrize("name", AT_ONE_CHANNEL)
def test_what_is_wrong_with_one_channel_fails_its_rows_alone(command: list[str], tmp_path: Path, name: str) -> None:
    """The rows of what is well pass, so that nobody looks for a second fault."""
    do_wrong, expected = AT_ONE_CHANNEL[name]
    with BoardBench(command, tmp_path / "board") as bench:
        do_wrong(bench)
        rows = walked(tmp_path / "board")
    assert failed(rows) == set(expected), {what: rows[what] for what in failed(rows)}
    for row, words in expected.items():
        assert words in rows[row].to_do


def test_a_noisy_sensor_fails_and_says_what_to_do(command: list[str], tmp_path: Path) -> None:
    """Noise of 2 kPa at one sensor fails its row at rest; the others stay well."""
    draw = random.Random(0)  # noqa: S311 - noise is no secret
    with BoardBench(command, tmp_path / "board") as bench:
        disturbed(bench, 0, lambda: draw.gauss(0.0, 2.0 * UV_PER_KPA))
        rows = walked(tmp_path / "board")
    at_rest = {what for what in failed(rows) if what.endswith("at rest")}
    assert at_rest == {"sensor peroneal_left at rest"}
    assert "loose wire" in rows["sensor peroneal_left at rest"].to_do


def test_a_calibration_takes_out_gain_and_offset(command: list[str], tmp_path: Path) -> None:
    """Sensors that read 3 % and 2 kPa wrong agree with the gauge to the noise after two points; stored for good."""
    with BoardBench(command, tmp_path / "board", store=tmp_path / "store") as bench:
        true_pins_uv = bench.plant.pins_uv
        bench.plant.pins_uv = lambda: [*(round(0.97 * uv) + 90_000 for uv in true_pins_uv()[:4]), 3_000_000]

        def read(question: str) -> float:
            ambient_kpa, held_kpa = 101.325, bench.plant.pressures_pa["manifold"] / 1e3
            return ambient_kpa - held_kpa if "gauge" in question else ambient_kpa

        rows = walked(tmp_path / "board", Person(read))
        assert rows["calibration"].passed, rows["calibration"]
        host = Host(tmp_path / "board")
        host.tick_until(lambda: len(host.exchanges) > 1)
        host.link.close()
        readings = host.exchanges[-1].sensors_pa
        assert not host.link.status.faults
    assert (tmp_path / "store").stat().st_size > 0
    for place in CHANNELS:
        assert readings[place] == pytest.approx(101325.0, abs=400.0)


def test_a_calibration_can_be_made_where_the_pump_failed(command: list[str], tmp_path: Path) -> None:
    """A bad calibration makes the pump look bad; where the pump truly is, the sensors do not move, and that is said."""
    plant = BoardPlant(dataclasses.replace(HEALTHY, pump_free_flow_l_min=1e-6))
    with BoardBench(command, tmp_path / "board", plant) as bench:
        rows = walked(tmp_path / "board", Person(lambda question: 60.0 if "gauge" in question else 101.3))
        assert bench.released
    assert not rows["pump"].passed
    assert "it does not measure" in rows["calibration"].to_do


def test_points_that_make_no_line_are_refused() -> None:
    """Too close, or a sensor that does not move: nothing is written."""
    with pytest.raises(InputError, match=r"10\.0 kPa apart"):
        sensor_lines({"achilles": 100.0}, 100e3, {"achilles": 900.0}, 90e3)
    with pytest.raises(InputError, match="achilles reads 100"):
        sensor_lines({"achilles": 100.0}, 100e3, {"achilles": 101.0}, 50e3)
    for air_pa in (1013e3, 1.013e3, math.nan):  # hPa, bar, nothing
        with pytest.raises(InputError, match="must be 50 to 110 kPa"):
            sensor_lines({"achilles": 100.0}, air_pa, {"achilles": 900.0}, 50e3)
    for held_pa in (-400e3, math.nan):
        with pytest.raises(InputError, match="less than the air itself"):
            sensor_lines({"achilles": 100.0}, 100e3, {"achilles": 900.0}, held_pa)


def test_a_bought_board_gets_its_calibration_in_a_file(tmp_path: Path) -> None:
    """Scale and offset go into a copy of the board file that the driver reads."""
    places = load_wiring(None).sensors
    lines = sensor_lines(dict.fromkeys(places, 800.0), 100e3, dict.fromkeys(places, 400.0), 50e3)
    write_board_file(standard_board_file(), tmp_path / "mine.yaml", lines)
    assert yaml.safe_load((tmp_path / "mine.yaml").read_text())["firmware"] == "jammkle"
    sensor = load_wiring(tmp_path / "mine.yaml").sensors["achilles"]
    assert sensor.pascals(600) == pytest.approx(75e3)


class GaugesThatTurnOver:
    """Talks as the bought board of the example: its manifold's number has noise around zero, and is signed."""

    def __init__(self, wiring: Wiring) -> None:
        self.wiring, self.vacuum_pa, self.draw = wiring, 0.0, random.Random(1)  # noqa: S311 - noise

    async def exchange(self, command: ActuatorCommand) -> Exchange:
        driven = command.pump_duty > 0.0 or any(command.solenoids.values())
        self.vacuum_pa = self.vacuum_pa + 0.2 * (50e3 - self.vacuum_pa) if driven else 0.0
        absolute = round((101325.0 - self.vacuum_pa + 10000.0) / 2.5)
        numbers = dict.fromkeys(CHANNELS, absolute)
        numbers[MANIFOLD] = round(-self.vacuum_pa / 10.0 + self.draw.gauss(0.0, 2.0)) & 0xFFFF
        pascals = {place: self.wiring.sensors[place].pascals(number) for place, number in numbers.items()}
        return Exchange(pascals, numbers, command)

    async def acknowledge(self) -> None:
        """Take jams again."""


def test_a_signed_sensor_is_calibrated_around_zero(tmp_path: Path) -> None:
    """As a transmitter of vacuum has it at the pressure of the air: a mean of its register's bits would be nonsense."""
    source, target = standard_board_file().with_name("board_bought.yaml"), tmp_path / "mine.yaml"
    wiring = load_wiring(source)
    talk = GaugesThatTurnOver(wiring)

    def read(question: str) -> float:
        return talk.vacuum_pa / 1e3 if "gauge" in question else 101.325

    options = CommissioningOptions("", wiring, source, target, calibrates=True, pace=PACE)
    probe = Probe(talk, wiring, PACE)

    async def calibrate() -> CheckRow:
        await probe.vent()
        await probe.rest(0.1)
        return await _Calibration(options, None, probe, Person(read)).row()

    assert asyncio.run(calibrate()).passed
    manifold = load_wiring(target).sensors[MANIFOLD]
    for vacuum_pa in (0.0, 25e3, 50e3):
        assert manifold.pascals(round(-vacuum_pa / 10.0) & 0xFFFF) == pytest.approx(101325.0 - vacuum_pa, abs=100.0)


OTHER_FIRMWARE = """
firmware: other
pump: {register: 1}
solenoids: {peroneal_left: {coil: 0}, peroneal_right: {coil: 1}, achilles: {coil: 2}}
sensors:
  peroneal_left: {register: 13, scale: 7.0}
  peroneal_right: {register: 14, scale: 7.0}
  achilles: {register: 15, scale: 7.0}
  manifold: {register: 16, scale: 7.0}
reply_timeout_s: 0.15
on_connect: {2: 5000, 3: 4}
"""
"""The project's board taken for a bought one: raw numbers of the converter, and a calibration that is far out.

Its watchdog is set before its start is acknowledged: with its own 0.2 s a late reply would let it latch again.
"""


def test_a_board_of_other_make_is_walked_and_calibrated_too(command: list[str], tmp_path: Path) -> None:
    """Coils, a register and raw numbers alone: every row passes, and the new board file reads true pressures."""
    (tmp_path / "bought.yaml").write_text(OTHER_FIRMWARE)
    with BoardBench(command, tmp_path / "board") as bench:

        def read(question: str) -> float:
            return 101.325 - bench.plant.pressures_pa["manifold"] / 1e3 if "gauge" in question else 101.325

        wired = load_wiring(tmp_path / "bought.yaml")
        options = CommissioningOptions(
            str(tmp_path / "board"), wired, tmp_path / "bought.yaml", None, calibrates=True, pace=PACE
        )
        rows = {row.what: row for row in asyncio.run(commission(options, Person(read)))}
    assert failed(rows) <= {"sensors agree"}, rows
    made = load_wiring(tmp_path / "bought.calibrated.yaml").sensors["achilles"]
    share = 0.009 * 101.325 - 0.095  # of the sensor's supply, at this pressure
    assert made.pascals(round(16368 * share)) == pytest.approx(101325.0, abs=400.0)


@pytest.mark.parametrize(
    ("port", "code", "words"),
    [("nothing", 2, "/dev/jammkle_board"), ("/dev/none", 1, "no device"), ("tcp://", 2, "tcp://HOST")],
)
def test_a_port_that_is_none_gets_one_line(port: str, code: int, words: str) -> None:
    """Bad input ends with 2, a board that is not there with 1, each with what to do."""
    result = subprocess.run(
        [COMMAND, "hardware", "check", "--yes", "--port", port], capture_output=True, text=True, check=False
    )
    assert result.returncode == code
    assert words in result.stderr
    assert len(result.stderr.splitlines()) == 1
