"""The recorder as a process, with toy publishers over real DDS."""

from __future__ import annotations

import json
import resource
import shutil
import signal
import subprocess
import sys
import threading
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest
import rclpy
import yaml
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.executors import SingleThreadedExecutor
from rclpy.experimental import EventsExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from rclpy.signals import SignalHandlerOptions
from rosbags.highlevel import AnyReader
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Imu
from std_msgs.msg import Bool, Float32, String

from domains import wait_until
from jammkle_bringup.recorder import QUEUE_DEPTH, Losses, Recorder, TimeSource
from jammkle_common import names
from jammkle_common.bags.definitions import MessageDefinitions, share_folders
from jammkle_common.bags.recovery import recover
from jammkle_common.qos import publisher_qos, subscriber_qos
from jammkle_common.runner import StopFlag
from jammkle_msgs.msg import ChannelJamState, JamState

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from rclpy.node import Node

CHUNK_BYTES = 2**20
UNKNOWN = "_NODE_NAME_UNKNOWN_"
"""What rmw_dds_common has for a node that is not known yet."""
TIMEOUT_S = 30.0

READ_ELSEWHERE = """
import json, sys
from pathlib import Path

class Blocker:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {"jammkle_msgs", "jammkle_common", "jammkle_bringup", "rclpy", "std_msgs"}:
            raise ImportError(name)
        return None

sys.meta_path.insert(0, Blocker())
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

path = Path(sys.argv[1])
states = []
with AnyReader([path]) as reader:
    wanted = [connection for connection in reader.connections if connection.topic == "/jam_state"]
    for connection, _, data in reader.messages(wanted):
        states.append(reader.deserialize(data, connection.msgtype).channels[0].commanded_vacuum_pa)
with (path / (path.name + ".mcap")).open("rb") as file:
    topics = [channel.topic for _, channel, _ in make_reader(file).iter_messages()]
print(json.dumps({"states": states, "topics": topics}))
"""


@pytest.fixture
def node(ros_domain: int) -> Iterator[Node]:
    """Make a node in the test's domain."""
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=ros_domain, signal_handler_options=SignalHandlerOptions.NO)
    made = rclpy.create_node("toy", context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(made)
    yield made
    executor.shutdown()
    made.destroy_node()
    rclpy.shutdown(context=context)


class Recording:
    """A `jammkle record` process."""

    def __init__(self, folder: Path, *arguments: str) -> None:
        self.bag = folder / "bag"
        self._output = folder / "record.txt"
        with self._output.open("w") as output:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "jammkle_common.command", "record", "-o", str(self.bag), *arguments],
                stdout=output,
                stderr=output,
            )

    def subscribes(self, node: Node, *topics: str) -> None:
        """Wait until it subscribes to topics."""
        wait_until(
            lambda: all(
                any(info.node_name == "recorder" for info in node.get_subscriptions_info_by_topic(topic))
                for topic in topics
            ),
            f"the recorder subscribes to {topics}; it said: {self._output.read_text()}",
        )

    def end(self, number: signal.Signals = signal.SIGINT) -> None:
        """Ask it to stop and check that it ends well."""
        self.process.send_signal(number)
        assert self.process.wait(TIMEOUT_S) == 0, self._output.read_text()
        assert "Traceback" not in self._output.read_text()

    def said(self) -> list[str]:
        """Return the lines that it wrote, without the one that says that it began."""
        return [line for line in self._output.read_text().splitlines() if "Ctrl-C ends" not in line]

    def messages(self) -> list[tuple[str, int, Any]]:
        """Return topic, log time and message of everything in the bag."""
        with AnyReader([self.bag]) as reader:
            return [
                (connection.topic, log_ns, reader.deserialize(data, connection.msgtype))
                for connection, log_ns, data in reader.messages()
            ]


@pytest.fixture
def record(ros_domain: int, tmp_path: Path) -> Iterator[Callable[..., Recording]]:
    """Return a function that starts a recording in the test's domain."""
    assert ros_domain >= 0
    started: list[Recording] = []

    def start(*arguments: str) -> Recording:
        started.append(Recording(tmp_path, *arguments))
        return started[-1]

    yield start
    for recording in started:
        recording.process.terminate()
        recording.process.wait(TIMEOUT_S)


def matched(*publishers: Any) -> None:
    """Wait until everybody is matched who subscribes."""
    wait_until(lambda: all(each.get_subscription_count() > 0 for each in publishers), "they are matched")


def reached(publisher: Any) -> None:
    """Wait until what was published has arrived wherever it is subscribed to reliably."""
    assert publisher.wait_for_all_acked(rclpy.duration.Duration(seconds=TIMEOUT_S))


def jam_state(commanded_vacuum_pa: float) -> JamState:
    channel = ChannelJamState(channel=names.ACHILLES, commanded_vacuum_pa=commanded_vacuum_pa)
    return JamState(channels=[channel])


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_bag_opens_where_this_project_is_not_installed(
    node: Node, record: Callable[..., Recording], number: signal.Signals
) -> None:
    """After either signal the bag is complete, latched sample from before the start included, and needs no types."""
    publisher = node.create_publisher(JamState, "jam_state", publisher_qos(names.JAM_STATE))
    publisher.publish(jam_state(12e3))
    recording = record()
    recording.subscribes(node, "/jam_state")
    matched(publisher)
    reached(publisher)
    publisher.publish(jam_state(34e3))
    reached(publisher)
    recording.end(number)
    script = [sys.executable, "-c", READ_ELSEWHERE, str(recording.bag)]
    found = json.loads(subprocess.check_output(script, cwd="/"))
    assert found["states"] == [12e3, 34e3]
    assert found["topics"].count("/jam_state") == 2


def test_metadata_says_version_types_hashes_and_how_topics_were_offered(
    node: Node, record: Callable[..., Recording]
) -> None:
    """metadata.yaml has version 9, the publishers' QoS, the hash that ROS itself announces, and sim_parameters."""
    state = node.create_publisher(JamState, "jam_state", publisher_qos(names.JAM_STATE))
    parameters = node.create_publisher(String, "sim_parameters", publisher_qos(names.SIM_PARAMETERS))
    sensor = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
    imu = node.create_publisher(Imu, "imu/data", sensor)
    recording = record()
    recording.subscribes(node, "/jam_state", "/sim_parameters", "/imu/data")
    state.publish(jam_state(1.0))
    parameters.publish(String(data="slope_deg: 40.0"))
    # the recorder asks for less than it first did once it sees that this publisher is best effort
    subscribed = "/imu/data"
    wait_until(
        lambda: any(
            info.node_name == "recorder" and info.qos_profile.reliability is ReliabilityPolicy.BEST_EFFORT
            for info in node.get_subscriptions_info_by_topic(subscribed)
        ),
        "the recorder matches a best-effort publisher",
    )
    matched(imu)
    # best effort: the other end may not know of the match yet, so it is sent until it has filled a chunk of the bag

    def has_written() -> bool:
        for _ in range(100):
            imu.publish(Imu())
        return (recording.bag / "bag.mcap").stat().st_size > CHUNK_BYTES

    wait_until(has_written, "the recorder writes what it receives")
    reached(state)
    reached(parameters)
    recording.end()
    content = yaml.safe_load((recording.bag / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert content["version"] == 9
    assert content["storage_identifier"] == "mcap"
    assert content["custom_data"] == {"sim_parameters": "slope_deg: 40.0"}
    topics = {each["topic_metadata"]["name"]: each["topic_metadata"] for each in content["topics_with_message_count"]}
    (offered,) = topics["/jam_state"]["offered_qos_profiles"]
    assert (offered["reliability"], offered["durability"]) == ("reliable", "transient_local")
    (offered,) = topics["/imu/data"]["offered_qos_profiles"]
    assert (offered["reliability"], offered["durability"]) == ("best_effort", "volatile")
    (announced,) = node.get_publishers_info_by_topic("/jam_state")
    digest = bytes(announced.topic_type_hash.value).hex()
    assert topics["/jam_state"]["type_description_hash"] == f"RIHS01_{digest}"


def test_messages_wait_for_the_first_tick_and_take_simulated_time(node: Node, record: Callable[..., Recording]) -> None:
    """Under /clock, what came before the first tick is logged with that tick, and later messages with theirs.

    The recorder's own reports are stamped with ticks as well, and with 0 before the first.
    """
    duty = node.create_publisher(Float32, "pump/duty", publisher_qos(names.PUMP_DUTY))
    clock = node.create_publisher(Clock, "/clock", QoSProfile(depth=10))
    recording = record("--clock", "sim")
    recording.subscribes(node, "/pump/duty", "/clock")
    matched(duty, clock)
    duty.publish(Float32(data=0.25))
    reached(duty)
    for second in (7, 8):
        clock.publish(Clock(clock=Time(sec=second)))
    recording.end()
    messages = list(recording.messages())
    logged = {(topic, log_ns) for topic, log_ns, _ in messages}
    stamps_s = {message.header.stamp.sec for topic, _, message in messages if topic == names.DIAGNOSTICS.name}
    assert stamps_s <= {0, 7, 8}
    assert ("/pump/duty", 7 * 10**9) in logged
    assert {log_ns for topic, log_ns in logged if topic == "/clock"} == {7 * 10**9, 8 * 10**9}


@pytest.mark.parametrize(
    ("count", "offered", "held_up"),
    [
        (2000, QoSProfile(depth=2000, reliability=ReliabilityPolicy.RELIABLE), False),
        (1000, publisher_qos(names.IMU), True),  # it keeps 2 s of 500 Hz
    ],
    ids=["as fast as the publisher can", "while the recorder is held up"],
)
def test_no_sample_is_lost(
    node: Node, record: Callable[..., Recording], *, count: int, offered: QoSProfile, held_up: bool
) -> None:
    """All are there, in order; what overflows the socket of a stopped recorder is sent again."""
    imu = node.create_publisher(Imu, "imu/data", offered)
    recording = record("--clock", "system")
    recording.subscribes(node, "/imu/data")
    matched(imu)
    if held_up:
        recording.process.send_signal(signal.SIGSTOP)
    for number in range(count):
        message = Imu()
        message.header.stamp.sec = number
        imu.publish(message)
    recording.process.send_signal(signal.SIGCONT)
    reached(imu)
    recording.end()
    stamps = [message.header.stamp.sec for topic, _, message in recording.messages() if topic == "/imu/data"]
    assert stamps == list(range(count))


@pytest.mark.parametrize("kind", [SingleThreadedExecutor, EventsExecutor])
@pytest.mark.parametrize("goes_on", [False, True])
def test_what_waits_at_the_end_is_recorded(
    node: Node, ros_domain: int, tmp_path: Path, kind: type[Any], *, goes_on: bool
) -> None:
    """Also where all timers are due, as after a pause of the process, and while others publish on."""
    imu = node.create_publisher(Imu, "imu/data", publisher_qos(names.IMU))
    other = node.create_publisher(String, "other", QoSProfile(depth=1))
    rclpy.init(domain_id=ros_domain, signal_handler_options=SignalHandlerOptions.NO)
    recorder = Recorder(tmp_path / "bag", "/", TimeSource.SYSTEM)
    executor = kind()
    executor.add_node(recorder)

    def subscribes() -> bool:
        executor.spin_once(timeout_sec=0.01)
        return bool(recorder.get_subscriptions_info_by_topic("/other"))

    wait_until(subscribes, "it subscribes to what it discovers")
    matched(imu)
    matched(other)
    for number in range(100):
        message = Imu()
        message.header.stamp.sec = number
        imu.publish(message)
    reached(imu)
    wait_until(lambda: all(timer.is_ready() for timer in recorder.timers), "all timers are due")
    stop = StopFlag()
    stop.stop()
    ended = threading.Event()

    def publish_on() -> None:
        while goes_on and not ended.is_set():
            other.publish(String(data="on and on"))

    thread = threading.Thread(target=publish_on)
    thread.start()
    recorder.drive(executor, stop)
    ended.set()
    thread.join()
    executor.shutdown()
    recorder.destroy_node()
    rclpy.shutdown()
    with AnyReader([tmp_path / "bag"]) as reader:
        assert sum(connection.topic == "/imu/data" for connection, _, _ in reader.messages()) == 100


def test_what_a_busy_machine_loses_is_counted(node: Node, record: Callable[..., Recording]) -> None:
    """On /diagnostics and at the end: of best effort, more than the queue holds came while the recorder had no time."""
    said: list[str] = []

    def take(array: DiagnosticArray) -> None:
        said.extend(status.message for status in array.status if status.level == DiagnosticStatus.WARN)

    node.create_subscription(DiagnosticArray, names.DIAGNOSTICS.name, take, subscriber_qos(names.DIAGNOSTICS))
    imu = node.create_publisher(Imu, "foreign/imu", QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT))
    recording = record("--clock", "system")
    recording.subscribes(node, "/foreign/imu")
    matched(imu)
    published = 0

    def publish(count: int) -> None:
        nonlocal published
        for _ in range(count):
            published += 1
            message = Imu()
            message.header.stamp.sec = published
            imu.publish(message)

    publish(3)
    recording.process.send_signal(signal.SIGSTOP)
    publish(2 * QUEUE_DEPTH)
    recording.process.send_signal(signal.SIGCONT)

    def reported() -> bool:
        publish(1)
        node.executor.spin_once(timeout_sec=0.02)
        return any("of /foreign/imu" in text for text in said)

    wait_until(reported, "the recorder warns of what was lost")
    recording.end()
    stamps = [message.header.stamp.sec for topic, _, message in recording.messages() if topic == "/foreign/imu"]
    lost = stamps[-1] - stamps[0] + 1 - len(stamps)
    assert lost > 0
    assert any(f"lost: {lost} of /foreign/imu" in line for line in recording.said())


def test_only_the_namespace_and_what_is_said_of_it_outside_is_recorded(
    node: Node, record: Callable[..., Recording]
) -> None:
    """Topics of a namespace are found as they appear; other ankles are left out; bytes are kept as they came."""
    recording = record("--namespace", "/lf_ankle")
    recording.subscribes(node, "/lf_ankle/jam_state")
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    late = node.create_publisher(Bool, "/lf_ankle/something_new", latched)
    other = node.create_publisher(Bool, "/rf_ankle/something_new", latched)
    late.publish(Bool(data=True))
    other.publish(Bool(data=True))
    recording.subscribes(node, "/lf_ankle/something_new")
    matched(late)
    reached(late)
    recording.end()
    with AnyReader([recording.bag]) as reader:
        found = [(connection.topic, bytes(data)) for connection, _, data in reader.messages()]
    found = [each for each in found if each[0] != names.DIAGNOSTICS.name]  # the recorder's own reports
    # the last bytes are padding, which nobody sets
    size = 5
    assert [(topic, data[:size]) for topic, data in found] == [
        ("/lf_ankle/something_new", serialize_message(Bool(data=True))[:size])
    ]


def publish_until_it_ends(node: Node, recording: Recording) -> None:
    """Publish 64 KiB every 10 ms until the recorder has ended."""
    publisher = node.create_publisher(String, "chatter", QoSProfile(depth=10))
    text = String(data="x" * 65536)

    def ended() -> bool:
        publisher.publish(text)
        return recording.process.poll() is not None

    wait_until(ended, "the recorder ends")


def test_a_full_disk_ends_the_recorder_with_one_line(node: Node, record: Callable[..., Recording]) -> None:
    """When the file cannot grow, it says which bag and why, and exits with 1."""
    recording = record("--clock", "system")
    resource.prlimit(recording.process.pid, resource.RLIMIT_FSIZE, (3_000_000, 3_000_000))
    recording.subscribes(node, "/jam_state")
    publish_until_it_ends(node, recording)
    assert recording.process.returncode == 1
    (line,) = recording.said()
    assert str(recording.bag) in line
    assert "File too large; it is whole up to there" in line
    assert f"with {len(recording.messages())} messages" in line


def test_a_killed_recorder_leaves_what_came_until_a_moment_before(node: Node, record: Callable[..., Recording]) -> None:
    """After SIGKILL everything that was received a second before is there once the bag is recovered, and it opens."""
    publisher = node.create_publisher(String, "chatter", QoSProfile(depth=100))
    recording = record("--clock", "system")
    recording.subscribes(node, "/chatter")
    matched(publisher)
    words = [f"word {number:03}" for number in range(100)]
    for word in words:
        publisher.publish(String(data=word))
    file = recording.bag / "bag.mcap"
    wait_until(lambda: words[-1].encode() in file.read_bytes(), "it is flushed without another message")
    recording.process.kill()
    recording.process.wait(TIMEOUT_S)
    recovered = recover(recording.bag, lambda _: None).messages
    found = recording.messages()
    assert recovered == len(found)
    assert [message.data for topic, _, message in found if topic == "/chatter"] == words


def test_hidden_topics_are_left_out_without_a_word(node: Node, record: Callable[..., Recording]) -> None:
    """A hidden topic, as every action server has, makes no warning and no topic in the bag."""
    hidden = node.create_publisher(String, "sim/_action/status", QoSProfile(depth=1))
    publisher = node.create_publisher(String, "chatter", QoSProfile(depth=100))
    recording = record("--clock", "system")
    recording.subscribes(node, "/chatter")  # it has looked at the graph
    matched(publisher)
    publisher.publish(String(data="x"))
    reached(publisher)
    recording.end()
    node.destroy_publisher(hidden)
    assert {topic for topic, _, _ in recording.messages()} - {names.DIAGNOSTICS.name} == {"/chatter"}
    assert not [line for line in recording.said() if "not recorded" in line]


def test_a_removed_folder_ends_the_recorder_with_one_line(node: Node, record: Callable[..., Recording]) -> None:
    """A bag whose folder is gone would be lost without a word; it is noticed at once."""
    recording = record("--clock", "system")
    recording.subscribes(node, "/jam_state")
    shutil.rmtree(recording.bag)
    wait_until(lambda: recording.process.poll() is not None, "the recorder ends")
    assert recording.process.returncode == 1
    (line,) = recording.said()
    assert str(recording.bag) in line
    assert "folder is gone" in line


@pytest.mark.parametrize("topic", names.TOPICS, ids=lambda topic: topic.name)
def test_every_topic_of_the_graph_has_a_definition_to_embed(topic: names.Topic) -> None:
    """The text found for a type defines it and all inside it, with the hash that its package was built with."""
    package, folder, name = topic.message_type.split("/")
    definition = MessageDefinitions(share_folders()).find(topic.message_type)
    (built,) = [
        share / package / folder / f"{name}.json"
        for share in share_folders()
        if (share / package / folder / f"{name}.json").is_file()
    ][:1]
    hashes = {each["type_name"]: each["hash_string"] for each in json.loads(built.read_text())["type_hashes"]}
    assert definition.type_hash == hashes[topic.message_type]


def test_a_publisher_whose_node_is_not_known_yet_decides_nothing() -> None:
    """A node's name comes after its publishers; meanwhile all that are unknown look like the one that makes /clock."""
    unknown, sim, driver = (SimpleNamespace(node_namespace="/", node_name=name) for name in (UNKNOWN, "sim", "driver"))
    graph = {"/clock": [unknown], "/duty": [unknown], "/imu": [unknown]}
    recorder = Recorder.__new__(Recorder)
    recorder._of_clock_maker = {}
    recorder.get_publishers_info_by_topic = graph.__getitem__  # type: ignore[method-assign]
    assert not recorder._is_of_clock_maker("/duty")
    graph.update({"/clock": [sim], "/duty": [driver], "/imu": [sim]})
    assert not recorder._is_of_clock_maker("/duty")
    assert recorder._is_of_clock_maker("/imu")


def test_a_recorder_reports_where_it_records_and_what_it_cannot(node: Node, record: Callable[..., Recording]) -> None:
    """On /diagnostics while it runs, as a warning where a topic has two types; and that it ends, once it does."""
    reports: dict[str, DiagnosticStatus] = {}

    def take(array: DiagnosticArray) -> None:
        reports.update({status.name: status for status in array.status})

    node.create_subscription(DiagnosticArray, names.DIAGNOSTICS.name, take, subscriber_qos(names.DIAGNOSTICS))
    recording = record("--clock", "system")

    def reported(line: str, words: str) -> bool:
        node.executor.spin_once(timeout_sec=0.05)
        return line in reports and words in reports[line].message

    wait_until(lambda: reported("/recorder: recording", f"recording into {recording.bag}"), "it reports")
    assert reports["/recorder: recording"].level == DiagnosticStatus.OK
    node.create_publisher(String, "jam_state", 1)
    wait_until(lambda: reported("/recorder: recording", "/jam_state: it has several types"), "it says what it lacks")
    assert reports["/recorder: recording"].level == DiagnosticStatus.WARN
    recording.end()
    wait_until(lambda: reported("/recorder: stopped", "in order"), "it says that it ends")


def test_a_second_publisher_with_higher_numbers_is_no_loss() -> None:
    """What was counted as it began is taken back, and what either loses later is counted."""
    losses = Losses()
    for number in (10, 11, 500_000, 12, 13, 500_001):
        losses.take("/joint_states", number, of_one_publisher=True)
    assert losses.by_topic == {}
    for number in (15, 500_005):
        losses.take("/joint_states", number, of_one_publisher=True)
    assert losses.by_topic == {"/joint_states": 4}


def test_a_second_publisher_that_is_not_seen_yet_is_no_loss() -> None:
    """Its numbers go on beside those of the first, and what each of them loses is counted; so does one begun anew."""
    losses = Losses()
    for number in (17_000, 1, 17_001, 2, 17_002, 3):
        losses.take("/joint_states", number, of_one_publisher=True)
    assert losses.by_topic == {}
    losses.take("/joint_states", 17_005, of_one_publisher=True)
    losses.take("/joint_states", 5, of_one_publisher=True)
    assert losses.by_topic == {"/joint_states": 3}
    for number in (17_006, 9, 17_050):
        losses.take("/joint_states", number, of_one_publisher=False)
    losses.take("/joint_states", 17_100, of_one_publisher=True)
    assert losses.by_topic == {"/joint_states": 3}
