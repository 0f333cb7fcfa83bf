"""Whether the foot stands where no touch-down was felt: shown by something, said by a person, or unknown."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from controller_bench import LANDED_AT_S
from diagnostic_msgs.msg import DiagnosticStatus
from std_srvs.srv import SetBool

from jammkle_common.constants import NANOSECONDS_PER_SECOND
from jammkle_common.messages import Level
from jammkle_common.names import CHANNELS, CONTACT_STATE, SET_AUTO, SET_CONTACT, UNJAM
from jammkle_common.parameters import ParameterError
from jammkle_common.qos import subscriber_qos
from jammkle_controller.core.controller import AnkleController
from jammkle_controller.core.events import Contact, ContactKind
from jammkle_controller.core.inputs import AnkleAngles, Input
from jammkle_controller.core.leg_contact import LoadContact
from jammkle_controller.core.reading import Received
from jammkle_controller.core.stepping import DWELL_TIME_S
from jammkle_controller.node import contact_health
from jammkle_controller.parameters import ControllerParameters
from jammkle_msgs.msg import ChannelJamState, ContactState, JamState

if TYPE_CHECKING:
    from collections.abc import Callable

    from controller_bench import Bench

    from conftest import Streams
    from jammkle_controller.core.imu import ImuSample

MOUNTS = ("foot", "shank", "body")
HELD = dict.fromkeys(CHANNELS, 40e3)
SOFT = dict.fromkeys(CHANNELS, 0.0)


def at_rest(streams: Streams, duration_s: float = 1.6) -> list[ImuSample]:
    return streams.sense(streams.rest(duration_s), 500)


def new_controller(mount: str = "body", **parameters: object) -> AnkleController:
    return AnkleController(ControllerParameters(imu_mount=mount, **parameters))


def feel(
    controller: AnkleController,
    samples: list[ImuSample],
    receive: Callable[[AnkleController, int], object] | None = None,
) -> AnkleController:
    """Let a controller feel samples, and receive something before each tenth of them."""
    for number, sample in enumerate(samples):
        if receive is not None and number % 10 == 0:
            receive(controller, sample.time_ns)
        controller.update(sample)
    return controller


@pytest.mark.parametrize("mount", MOUNTS)
def test_what_rests_unexplained_is_unknown_held_and_a_warning(streams: Streams, mount: str) -> None:
    """An IMU at rest cannot separate standing from hanging: held after 1 s, unknown all the same, and a warning."""
    controller = feel(new_controller(mount), at_rest(streams, 0.9))
    assert (controller.contact.contact, controller.set_points_pa) == (Contact.UNKNOWN, SOFT)
    controller = feel(new_controller(mount), at_rest(streams, 2.5))
    assert controller.contact.contact is Contact.UNKNOWN
    assert controller.contact.at_rest
    assert controller.set_points_pa == HELD
    health = contact_health(controller, (), is_soft_in_stance=False)
    assert health.level is Level.WARN
    assert SET_CONTACT.path in health.message


@pytest.mark.parametrize(
    ("receive", "contact"),
    [
        (lambda c, ns: c.take(Received(ns, Input.LOAD, -3.4)), Contact.NO_CONTACT),
        (lambda c, ns: c.take(Received(ns, Input.LOAD, 14.0)), Contact.CONTACT),
        (lambda c, ns: c.take(Received(ns, Input.LOAD, -0.5)), Contact.UNKNOWN),
        (lambda c, ns: c.take(Received(ns, Input.CONTACT_SWITCH, 0.0)), Contact.NO_CONTACT),
        (lambda c, ns: c.take(Received(ns, Input.CONTACT_SWITCH, 1.0)), Contact.CONTACT),
        (lambda c, ns: c.take(Received(ns, Input.PLANNED_CONTACT, 0.0)), Contact.NO_CONTACT),
        (lambda c, ns: c.take(Received(ns, Input.PLANNED_CONTACT, 1.0)), Contact.CONTACT),
        (lambda c, ns: c.take(Received(ns, AnkleAngles(0.0, -0.065))), Contact.CONTACT),
        (lambda c, ns: c.take(Received(ns, AnkleAngles(0.0, 0.014))), Contact.UNKNOWN),
    ],
    ids=["hangs on cell", "presses", "cell unsure", "open", "closed", "air planned", "stance planned", "bent", "level"],
)
@pytest.mark.parametrize("mount", MOUNTS)
def test_what_else_is_known_decides_for_what_rests(
    streams: Streams, mount: str, receive: Callable[[AnkleController, int], object], contact: Contact
) -> None:
    """A load cell's sign, a switch, a gait and the soft ankle's angle show stance or hanging; only hanging is soft."""
    controller = feel(new_controller(mount), at_rest(streams), receive)
    assert controller.contact.contact is contact
    assert controller.set_points_pa == (SOFT if contact is Contact.NO_CONTACT else HELD)


def test_a_person_says_that_it_stands_or_hangs_until_something_is_felt(streams: Streams) -> None:
    """`set_contact` holds or frees at once and while it rests; a landing ends it; a switch is believed more."""
    fall, _ = streams.drop(150.0, 0.5)
    controller = feel(new_controller(), at_rest(streams, 0.5))
    assert controller.set_contact(stands=True) == ""
    assert (controller.contact.contact, controller.set_points_pa) == (Contact.CONTACT, HELD)
    controller = feel(new_controller(), at_rest(streams, 0.5))
    assert controller.set_contact(stands=False) == ""
    held_up = [sample._replace(time_ns=sample.time_ns + 500_000_000) for sample in at_rest(streams, 2.0)]
    feel(controller, held_up)
    assert (controller.contact.contact, controller.set_points_pa) == (Contact.NO_CONTACT, SOFT)
    feel(controller, [s._replace(time_ns=s.time_ns + 2_500_000_000) for s in streams.sense(fall, 500)])
    assert (controller.contact.contact, controller.set_points_pa) == (Contact.CONTACT, HELD)
    feel(controller, [], None)
    controller.take(Received(controller.gate.last_ns or 0, Input.CONTACT_SWITCH, 0.0))
    assert "contact switch" in controller.set_contact(stands=True)


@pytest.mark.parametrize("imu_s", [None, 1.0])
def test_a_load_refuses_what_a_person_says_without_an_imu_too(streams: Streams, imu_s: float | None) -> None:
    """With no IMU ever, or one that has been silent for long; a load that is silent itself refuses nothing."""
    controller = new_controller(use_load=True)
    feel(controller, at_rest(streams, imu_s) if imu_s else [])
    begin_ns = 100 * NANOSECONDS_PER_SECOND
    for number in range(200):
        controller.take(Received(begin_ns + number * 10_000_000, Input.LOAD, 20.0 if number < 100 else 0.0))
    assert "load shows that the foot does not stand" in controller.set_contact(stands=True)
    controller.go_on(begin_ns + 3 * NANOSECONDS_PER_SECOND)
    assert controller.set_contact(stands=True) == ""


def test_what_a_person_said_is_forgotten_on_the_way_back(streams: Streams) -> None:
    """After `forget_hand` what rests is held again, whatever was said of it."""
    controller = feel(new_controller(), at_rest(streams))
    controller.set_contact(stands=False)
    controller.forget_hand()
    later = [sample._replace(time_ns=sample.time_ns + 1_600_000_000) for sample in at_rest(streams)]
    assert feel(controller, later).set_points_pa == HELD


def test_an_imu_that_is_not_believed_makes_contact_unknown(streams: Streams) -> None:
    """What was felt on it counts no longer; what is held stays held, and a person may say so of what was soft."""
    fall, _ = streams.drop(150.0, 0.5)
    samples = streams.sense(fall, 500)
    controller = feel(new_controller(), samples)
    assert controller.contact.contact is Contact.CONTACT
    last_ns = samples[-1].time_ns
    feel(controller, [samples[-1]._replace(time_ns=last_ns + n * 2_000_000) for n in range(1, 300)])
    assert (controller.contact.contact, controller.set_points_pa) == (Contact.UNKNOWN, HELD)
    controller.set_contact(stands=False)
    assert controller.set_points_pa == SOFT
    controller.set_contact(stands=True)
    assert controller.set_points_pa == HELD


def test_contact_is_reported_and_a_soft_stance_with_the_way_back(make_bench: Callable[..., Bench]) -> None:
    """A channel vented by service in a stance: soft_in_stance and a WARN that names the way back, which sends anew."""
    bench = make_bench()
    reported: list[ContactState] = []
    bench.node.create_subscription(ContactState, CONTACT_STATE.name, reported.append, subscriber_qos(CONTACT_STATE))
    bench.spin_until(lambda: reported[-1:] != [] and reported[-1].contact == ContactState.UNKNOWN, "unknown at first")
    bench.driver_says(JamState(channels=[ChannelJamState(channel=channel) for channel in CHANNELS]))
    bench.land()
    bench.stand(LANDED_AT_S + 0.002, LANDED_AT_S + 0.1)
    bench.stand_until(lambda: reported[-1].contact == ContactState.CONTACT, "the landing is contact")
    assert "impact" in reported[-1].shown_by
    by_hand = [ChannelJamState(channel=channel, reason=f"asked by {UNJAM.name}") for channel in CHANNELS]
    bench.driver_says(JamState(channels=by_hand))
    bench.stand_until(lambda: reported[-1].soft_in_stance, "the soft stance is flagged")
    assert SET_AUTO.path in reported[-1].text
    bench.stand_until(lambda: bench.health["contact"].level == DiagnosticStatus.WARN, "and is a warning")
    assert SET_AUTO.path in bench.health["contact"].message
    bench.commands.clear()
    assert bench.set_auto(on=True).success
    bench.spin_until(lambda: any(command.anew for command in bench.commands), "the set point is sent anew")
    bench.commands.clear()
    answer = bench.call(SetBool, SET_CONTACT.path, SetBool.Request(data=False))
    assert answer.success
    bench.stand_until(
        lambda: any(c.anew for c in bench.commands) and bench.set_points_pa() == SOFT, "and vents on set_contact"
    )
    bench.stand_until(
        lambda: reported[-1].contact == ContactState.NO_CONTACT and not reported[-1].soft_in_stance, "it hangs"
    )
    bench.driver_says(JamState(channels=by_hand, emergency_stopped=True))
    bench.spin_until(lambda: "driver/clear_fault" in bench.set_auto(on=True).message, "what comes first is named")


def test_a_stance_is_not_held_with_more_than_a_slip_finds() -> None:
    """`hold_vacuum_pa` above `full_vacuum_pa` is refused with both values; as much is taken."""
    with pytest.raises(ParameterError, match=r"45000.*40000"):
        ControllerParameters(hold_vacuum_pa=45e3, full_vacuum_pa=40e3)
    ControllerParameters(hold_vacuum_pa=45e3, full_vacuum_pa=45e3)


@pytest.mark.parametrize("mount", ["foot", "shank"])
def test_a_touch_down_that_stillness_alone_suggests_is_no_evidence(streams: Streams, mount: str) -> None:
    """A foot that leaves by its gait's plan alone and stands on: held after a whole swing, and contact is unknown.

    Not before: at the first step of a walk a foot stands some 25 ms longer than planned, and was reported to touch down
    and to slip as it was lifted.
    """
    samples = at_rest(streams, 0.8)
    controller = feel(new_controller(mount), samples[:100])
    controller.take(Received(samples[99].time_ns, Input.PLANNED_CONTACT, 1.0))
    controller.take(Received(samples[99].time_ns, Input.PLANNED_CONTACT, 0.0))
    assert controller.contact.contact is Contact.NO_CONTACT
    events = [event for sample in samples[100:] for event in controller.update(sample).events]
    assert [event.kind for event in events][:1] == [ContactKind.IMPACT]
    assert events[0].time_ns - samples[99].time_ns >= DWELL_TIME_S * NANOSECONDS_PER_SECOND
    assert (controller.contact.contact, controller.set_points_pa) == (Contact.UNKNOWN, HELD)


def test_a_load_that_says_nothing_shows_no_stance() -> None:
    """Efforts presume nothing: neither stance nor swing before a load is clearly one of them."""
    load = LoadContact()
    for number in range(10):
        assert load.update(4.5, number * 10_000_000) is None
    assert load.stands is None
    assert load.update(20.0, 100_000_000) is None
    assert load.stands is True
    change = load.update(0.0, 110_000_000)
    assert change.kind is ContactKind.LIFTOFF
