"""Exercises beside one another: of one robot the second is refused, those of two robots go on."""

from __future__ import annotations

import contextlib
import os
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest
import rclpy
from builtin_interfaces.msg import Time
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
from std_msgs.msg import Float32

from jammkle_bringup import channels
from jammkle_bringup import exercise as exercises
from jammkle_bringup.core.supervisor import Death
from jammkle_bringup.exercise import HANG_PITCH, Limb, _Session, exercise
from jammkle_bringup.graph_client import COMMAND_NODE, GraphClient
from jammkle_common.bags.run_sheet import FILE_NAME, RunSheet
from jammkle_common.command.errors import GraphError, InputError
from jammkle_common.messages import AUTOMATIC, Health, Level, diagnostic_array
from jammkle_common.names import DRIVER_NODE, JOINT_STATES, PUMP_DUTY, SET_AUTO, resolved
from jammkle_common.qos import publisher_qos
from jammkle_msgs.msg import JamState
from jammkle_sim.robots.limb import LimbParameters

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from rclpy.node import Node


@pytest.fixture
def nodes(ros_domain: int) -> Iterator[list[Node]]:
    """Make a driver that answers nothing in each of three places, and an exercise of the robot `/one`."""
    with contextlib.ExitStack() as stack:
        context = rclpy.Context()
        rclpy.init(context=context, domain_id=ros_domain, signal_handler_options=SignalHandlerOptions.NO)
        stack.callback(rclpy.shutdown, context=context)
        made = []
        for namespace in ("/one/lf_ankle", "/one/rf_ankle", "/two"):
            made.append(rclpy.create_node(DRIVER_NODE, context=context, namespace=namespace))
            made[-1].create_publisher(Float32, PUMP_DUTY.name, publisher_qos(PUMP_DUTY))
        made.append(rclpy.create_node(f"{COMMAND_NODE}_0", context=context, namespace="/one"))
        for ankle in ("lf_ankle", "rf_ankle"):
            name = resolved(f"/one/{ankle}", JOINT_STATES.name)
            made[-1].create_publisher(JointState, name, publisher_qos(JOINT_STATES))
        for node in made:
            stack.callback(node.destroy_node)
        yield made


@pytest.mark.parametrize("namespace", ["/one", "/one/lf_ankle"])
def test_a_second_exercise_of_a_robot_is_refused(nodes: list[Node], tmp_path: Path, namespace: str) -> None:
    """Of the same namespace, and of one ankle of the robot; nothing is recorded."""
    assert nodes
    with pytest.raises(InputError, match=rf"another exercise is going on in .*\(/one/{COMMAND_NODE}_0\)"):
        exercise({tmp_path / "bag": RunSheet("press")}, namespace, lambda: False)
    assert not (tmp_path / "bag").exists()


def test_an_exercise_of_another_robot_is_in_nobodys_way(nodes: list[Node], tmp_path: Path) -> None:
    """It goes on to ask its driver, which does not answer here."""
    assert nodes
    with pytest.raises(GraphError, match="/two/driver/get_parameters did not answer"):
        exercise({tmp_path / "bag": RunSheet("press")}, "/two", lambda: False)


class Silent:
    """Stands for a client of a robot of two ankles, the first of which has a dead driver."""

    namespace = "/"
    call_each = GraphClient.call_each

    def __init__(self, *_: object) -> None:
        self.called: list[str] = []

    def ankles(self) -> tuple[str, ...]:
        return "lf_ankle", "rf_ankle"

    def call(self, path: str, _kind: object, _request: object) -> Any:
        self.called.append(path)
        if path.startswith("lf_ankle/driver"):
            msg = f"nothing answers on {path}"
            raise GraphError(msg)
        return SimpleNamespace(success=True, message="vented")


def test_one_dead_driver_keeps_no_other_ankle_jammed(monkeypatch: pytest.MonkeyPatch) -> None:
    """`jammkle unjam`, and the end of an exercise, ask every ankle before they say who did not answer."""
    client = Silent()
    monkeypatch.setattr(channels, "GraphClient", lambda *_: contextlib.nullcontext(client))
    with pytest.raises(GraphError, match="nothing answers on lf_ankle/driver/unjam"):
        channels.unjam("/", [], lambda: False)
    assert client.called == ["lf_ankle/driver/unjam", "rf_ankle/driver/unjam"]
    session = _Session.__new__(_Session)
    session._client, session._ankles = client, client.ankles()
    session._trajectory, session._were_automatic = SimpleNamespace(publish=lambda _: None), session._ankles
    client.called.clear()
    with pytest.raises(GraphError, match="nothing answers on lf_ankle/driver/unjam"):
        session.end()
    assert client.called[1:] == [
        "rf_ankle/driver/unjam", "lf_ankle/controller/set_auto", "rf_ankle/controller/set_auto",
    ]  # fmt: skip


def test_a_recorder_that_dies_ends_the_exercise() -> None:
    """A bag that is not whole is no result: what it said last is in the error."""
    died = Death("recorder", 1, ("bag cannot be written: No space left on device",))
    session = _Session.__new__(_Session)
    session._client = SimpleNamespace(wait_until=lambda *_: False)
    session._time_s, session._recorder = None, SimpleNamespace(first_death=lambda: died)
    with pytest.raises(GraphError, match="recorder died with exit code 1; it said: bag cannot be written"):
        session._wait(5.0)


def test_joints_of_other_nodes_leave_the_leg_known() -> None:
    """A head that publishes its own joint in mid-press neither takes hip and knee away nor gives a place."""
    places: list[JointState] = []
    session = _Session.__new__(_Session)
    session._joints, session._places = {}, {"": SimpleNamespace(publish=places.append)}
    session._built, session._hip_height_m = {HANG_PITCH: 0.0}, 0.29
    session._limb_over_ground = Limb(LimbParameters(), has_abduction=False)
    leg = JointState(name=["hip", "knee"], position=[0.5, -1.0])
    for message in (leg, JointState(name=["head_pan"], position=[0.1]), leg):
        session._take_joints("", message)
    assert session._joints[""] == {"hip": 0.5, "knee": -1.0, "head_pan": 0.1}
    assert [each.name for each in places] == [["carriage_x", "carriage"]] * 2
    assert places[0].position == places[1].position


@pytest.mark.parametrize(
    ("reports", "automatic_after"),
    [
        ({"lf_ankle": "true", "rf_ankle": "false"}, ["lf_ankle"]),
        ({"lf_ankle": "false", "rf_ankle": "false"}, []),
        ({"rf_ankle": "true"}, ["lf_ankle", "rf_ankle"]),
    ],
    ids=["one was off", "both were off", "one says nothing"],
)
def test_automatic_jamming_is_afterwards_as_it_was_before(reports: dict[str, str], automatic_after: list[str]) -> None:
    """It is off during the exercise, and comes on again where it was on."""
    called: list[tuple[str, bool]] = []

    def call_each(ankles: tuple[str, ...], path: str, _kind: object, request: Any) -> dict[str, Any]:
        called.extend((ankle, request.data) for ankle in ankles if path == SET_AUTO.path)
        return {}

    session = _Session.__new__(_Session)
    session._client = SimpleNamespace(namespace="/", call_each=call_each, wait_until=lambda *_: False)
    session._ankles, session._automatic = ("lf_ankle", "rf_ankle"), {}
    session._trajectory = SimpleNamespace(publish=lambda _: None)
    for ankle, said in reports.items():
        health = [Health("policy", Level.OK, "as it says", {AUTOMATIC: said})]
        session._take_health(diagnostic_array(Time(), f"/{ankle}/controller", "ankle", health))
    session.begin()
    assert called == [("lf_ankle", False), ("rf_ankle", False)]
    called.clear()
    session.end()
    assert called == [(ankle, True) for ankle in automatic_after]


@pytest.mark.parametrize(
    ("vacuum_pa", "said"),
    [
        (75e3, r"press asks for 75 kPa, and the driver of rf_ankle takes 10 to 70 kPa \(its min_vacuum_pa"),
        (5e3, "press asks for 5 kPa"),
        (70e3, None),
    ],
)
def test_a_vacuum_that_a_driver_refuses_is_refused_beforehand(vacuum_pa: float, said: str | None) -> None:
    """By the limits in its jam_state; one that names none is asked later."""
    session = _Session.__new__(_Session)
    session._client, session._ankles = SimpleNamespace(wait_until=lambda *_: True), ("lf_ankle", "rf_ankle")
    session._states = {"lf_ankle": JamState(), "rf_ankle": JamState(min_vacuum_pa=10e3, max_vacuum_pa=70e3)}
    session._built = {"hang_pitch_deg": 30.0}
    session._joints = {each: {"hip": 0.5, "knee": 1.0} for each in session._ankles}
    refused = contextlib.nullcontext() if said is None else pytest.raises(InputError, match=said)
    with refused:
        session.check(RunSheet("press", {"vacuum_pa": vacuum_pa}))


def test_a_stopped_exercise_is_done_again(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its bag without a run sheet is set aside, once the robot is this command's; a whole one is in the way."""
    bag = tmp_path / "press"
    bag.mkdir()
    (bag / "metadata.yaml").touch()
    done: list[str] = []
    with pytest.raises(InputError, match="it is being recorded, or its exercise has just been stopped"):
        exercise({bag: RunSheet("press")}, "/", lambda: False)
    for path in (bag / "metadata.yaml", bag):
        os.utime(path, (0.0, 0.0))

    class Ready:
        """A session that finds everything as it should be."""

        def __init__(self, _client: object) -> None:
            assert bag.exists()

        def check(self, _sheet: RunSheet) -> None:
            assert bag.exists()

        def begin(self) -> None:
            pass

        def do(self, sheet: RunSheet, bag: Path) -> None:
            bag.mkdir()
            (bag / FILE_NAME).touch()
            done.append(sheet.rig)

        def end(self) -> None:
            pass

    monkeypatch.setattr(exercises, "GraphClient", lambda *_: contextlib.nullcontext())
    monkeypatch.setattr(exercises, "_Session", Ready)
    exercise({bag: RunSheet("press")}, "/", lambda: False)
    assert done == ["press"]
    assert (tmp_path / "unfinished" / "press" / "metadata.yaml").is_file()
    assert f"{bag} has no run sheet, perhaps as its exercise was stopped" in capsys.readouterr().err
    with pytest.raises(InputError, match="press is there already"):
        exercise({bag: RunSheet("press")}, "/", lambda: False)


@pytest.mark.parametrize("name", ["press", "tilt"])
def test_nobody_is_asked_to_move_a_simulated_ankle(name: str) -> None:
    """It is refused with two ways out, before anything is recorded."""
    session = _Session.__new__(_Session)
    session._client = SimpleNamespace(
        namespace="/", nodes=lambda: {"/sim", "/driver"}, wait_until=lambda holds, _: holds()
    )
    session._joints, session._built, session._ankles, session._states = {"": {"ankle_pitch": 0.0}}, {}, [], {}
    with pytest.raises(InputError, match=f"`jammkle rig {name}` does it without the graph"):
        session.check(RunSheet(name))
