"""Log times of a recording: when a message was published, in whatever order and however late it was received."""

from __future__ import annotations

import random

from jammkle_bringup.recorder import LogTimes, Received, TimeSource

EPOCH_NS = 1_795_000_000_000_000_000
MS_NS = 1_000_000


class Log:
    """What was written."""

    def __init__(self, source: TimeSource) -> None:
        self.written: dict[str, int] = {}
        self.order: list[str] = []
        self.of_clock_maker: set[str] = set()
        self.times = LogTimes(source, self._write, lambda topic: topic in self.of_clock_maker)

    def _write(self, message: Received, log_ns: int) -> None:
        self.written[message.topic] = log_ns
        self.order.append(message.topic)


def tick(stamp_ns: int, source_ns: int) -> Received:
    return Received(f"/clock {stamp_ns}", b"", source_ns, stamp_ns)


def test_in_simulation_a_message_has_the_time_of_the_step_in_which_it_was_published() -> None:
    """Whoever makes /clock publishes before its tick, all others after it; arrival says nothing."""
    messages = [
        tick(2 * MS_NS, EPOCH_NS + 10),
        Received("/duty", b"", EPOCH_NS + 15),
        Received("/gait", b"", EPOCH_NS + 20),
        Received("/imu", b"", EPOCH_NS + 21, 3 * MS_NS),
        tick(4 * MS_NS, EPOCH_NS + 30),
        Received("/solenoid", b"", EPOCH_NS + 31),
        Received("/event", b"", EPOCH_NS + 32, 3 * MS_NS),
        tick(6 * MS_NS, EPOCH_NS + 40),
    ]
    ticks = [each for each in messages if each.topic.startswith("/clock")]
    others = [each for each in messages if each not in ticks]
    for seed in range(20):
        random.Random(seed).shuffle(others)  # noqa: S311 - an order, no secret
        log = Log(TimeSource.UNDECIDED)
        log.of_clock_maker = {"/gait", "/imu"}
        for each in others:
            log.times.take(each)
        for each in ticks:
            log.times.tick(each)
        log.times.end()
        assert log.written["/duty"] == 2 * MS_NS
        assert log.written["/gait"] == 4 * MS_NS
        assert log.written["/imu"] == 3 * MS_NS
        assert log.written["/solenoid"] == 4 * MS_NS
        assert log.written["/event"] == 4 * MS_NS
        assert log.times.source is TimeSource.SIMULATED


def test_who_publishes_a_topic_may_become_known_after_its_first_message() -> None:
    """A publisher is found before its node is: what its first message was taken for does not stay."""
    log = Log(TimeSource.SIMULATED)
    log.times.take(Received("/gait", b"", EPOCH_NS + 5))
    log.of_clock_maker = {"/gait"}
    log.times.tick(tick(2 * MS_NS, EPOCH_NS + 10))
    log.times.tick(tick(4 * MS_NS, EPOCH_NS + 20))
    assert log.written["/gait"] == 2 * MS_NS
    log.times.take(Received("/gait", b"", EPOCH_NS + 15))
    log.times.end()
    assert log.written["/gait"] == 4 * MS_NS


def test_what_was_resent_late_is_shifted_by_nothing() -> None:
    """A message that comes long after the ticks around it still has its own time."""
    log = Log(TimeSource.SIMULATED)
    for number in range(1, 1000):
        log.times.tick(tick(number * MS_NS, EPOCH_NS + number * 1000))
    log.times.take(Received("/late", b"", EPOCH_NS + 17_500))
    log.times.tick(tick(1000 * MS_NS, EPOCH_NS + 1_000_000))
    assert log.written["/late"] == 17 * MS_NS


def test_on_hardware_the_time_is_that_of_publishing() -> None:
    """Stamps that are near the publisher's own clock decide for the system's time, and arrival does not count."""
    log = Log(TimeSource.UNDECIDED)
    log.times.take(Received("/duty", b"", EPOCH_NS + 5))
    assert not log.written
    log.times.take(Received("/imu", b"", EPOCH_NS + 9, EPOCH_NS + 2))
    assert log.written == {"/duty": EPOCH_NS + 5, "/imu": EPOCH_NS + 9}
    assert log.times.source is TimeSource.SYSTEM


def test_simulated_stamps_wait_for_the_clock_that_comes_later() -> None:
    """A simulation that is seen before its /clock does not make a bag of the system's time."""
    log = Log(TimeSource.UNDECIDED)
    log.times.take(Received("/imu", b"", EPOCH_NS, 2 * MS_NS))
    assert log.times.source is TimeSource.SIMULATED
    assert not log.written
    log.times.tick(tick(4 * MS_NS, EPOCH_NS + 10))
    assert log.written["/imu"] == 2 * MS_NS


def test_a_tick_that_is_repeated_moves_nothing() -> None:
    """While time stands still, what is published belongs to that time, however often it is said."""
    log = Log(TimeSource.SIMULATED)
    log.times.tick(tick(MS_NS, EPOCH_NS + 10))
    log.times.take(Received("/jam_state", b"", EPOCH_NS + 50))
    log.times.tick(tick(MS_NS, EPOCH_NS + 90))
    assert log.written["/jam_state"] == MS_NS


def test_what_is_latched_from_before_has_the_time_of_the_begin() -> None:
    """Of the node that makes /clock or another's, found at once or later; a player would begin with silence."""
    log = Log(TimeSource.SIMULATED)
    log.of_clock_maker = {"/of_sim"}
    log.times.take(Received("/jam_state", b"", EPOCH_NS, 2 * MS_NS, is_from_before=True))
    log.times.take(Received("/of_sim", b"", EPOCH_NS, 2 * MS_NS, is_from_before=True))
    log.times.tick(tick(9000 * MS_NS, EPOCH_NS + 10))
    log.times.take(Received("/landing", b"", EPOCH_NS, 5 * MS_NS, is_from_before=True))
    log.times.tick(tick(9002 * MS_NS, EPOCH_NS + 20))
    written = {topic: log_ns for topic, log_ns in log.written.items() if not topic.startswith("/clock")}
    assert written == dict.fromkeys(("/jam_state", "/of_sim", "/landing"), 9000 * MS_NS)


def test_without_any_tick_nothing_is_lost() -> None:
    """A recording that ends before time has begun keeps its messages, at time zero."""
    log = Log(TimeSource.SIMULATED)
    log.times.take(Received("/duty", b"", EPOCH_NS))
    log.times.end()
    assert log.written == {"/duty": 0}


def test_what_was_stamped_before_the_first_tick_keeps_its_stamp() -> None:
    """A recorder may find /clock seconds after the sensors; a stamp that cannot be before that tick says nothing."""
    log = Log(TimeSource.SIMULATED)
    log.times.take(Received("/joints", b"", EPOCH_NS + 1, 5 * MS_NS))
    log.times.take(Received("/duty", b"", EPOCH_NS + 2))
    log.times.take(Received("/other", b"", EPOCH_NS + 3, EPOCH_NS))
    log.times.tick(tick(9 * MS_NS, EPOCH_NS + 10))
    assert log.written == {"/joints": 5 * MS_NS, "/duty": 9 * MS_NS, "/other": 9 * MS_NS, "/clock 9000000": 9 * MS_NS}
