"""What a robot may report of contact beside the IMU, each optional: switch, load, gait, joints, efforts, odometry."""

from __future__ import annotations

import enum
import math
import statistics
from collections import deque
from typing import TYPE_CHECKING, NamedTuple

from jammkle_common.constants import NANOSECONDS_PER_SECOND
from jammkle_controller.core.events import CHANGES, NO_UNIT, ContactEvent, Source
from jammkle_controller.core.leg_contact import AnkleContact, LegLoad, LoadContact
from jammkle_controller.core.slip import SoleSlip

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jammkle_controller.core.leg import Leg
    from jammkle_controller.core.leg_contact import AnkleReading, LegReading
    from jammkle_controller.core.slip import BodyTwist, LegPose
    from jammkle_controller.parameters import ControllerParameters

FLIGHTS = 3
"""As many flights in a row must have lasted about as long before the next one is foreseen."""
LARGEST_SPREAD = 0.15
"""Spread of those, over their mean, up to which they are alike: 45 ms in a swing of 0.3 s."""


class Rhythm:
    """Foresees the end of a flight or swing from how long the last ones took."""

    def __init__(self) -> None:
        """Know no flight."""
        self._lasted_ns: deque[int] = deque(maxlen=FLIGHTS)
        self._lifted_ns: int | None = None

    def lift(self, time_ns: int) -> None:
        """Note a lift-off."""
        self._lifted_ns = time_ns

    def land(self, time_ns: int) -> None:
        """Note a touch-down."""
        if self._lifted_ns is not None and time_ns > self._lifted_ns:
            self._lasted_ns.append(time_ns - self._lifted_ns)
        self._lifted_ns = None

    def forget(self) -> None:
        """Forget all: the clock was set back, or the IMU failed."""
        self._lasted_ns.clear()
        self._lifted_ns = None

    @property
    def touchdown_ns(self) -> int | None:
        """When this flight will end, ns; None: it is not known, or there is none."""
        if self._lifted_ns is None or len(self._lasted_ns) < FLIGHTS:
            return None
        mean_ns = statistics.fmean(self._lasted_ns)
        if statistics.pstdev(self._lasted_ns) > LARGEST_SPREAD * mean_ns:
            return None
        return self._lifted_ns + round(mean_ns)


class GaitPhase:
    """Foresees touch-downs from a phase that runs from 0, touch-down, to 1."""

    SILENT_S = 0.3
    """A phase that was received so long before or after a time is not one to plan with, s. After: a phase has the time
    at which it came, and a sample of the IMU its stamp, which lies before that."""
    SLOWEST_HZ = 0.05
    """Rate below which a phase stands still, Hz: a stride of 20 s."""

    def __init__(self) -> None:
        """Know no phase."""
        self._phase = 0.0
        self._time_ns: int | None = None
        self._rate_hz = 0.0
        self._early_s = 0.0

    def on_phase(self, phase: float, time_ns: int) -> None:
        """Take the phase, 0 to 1, at a time, ns; of several at one reading of the clock the first."""
        if time_ns == self._time_ns:
            return
        if self._time_ns is not None and 0 < time_ns - self._time_ns < self.SILENT_S * NANOSECONDS_PER_SECOND:
            gained = (phase - self._phase + 0.5) % 1.0 - 0.5  # one that stands may jitter backwards
            rate_hz = gained * NANOSECONDS_PER_SECOND / (time_ns - self._time_ns)
            rate_hz = rate_hz if self._rate_hz == 0.0 else self._rate_hz + 0.2 * (rate_hz - self._rate_hz)
            self._rate_hz = rate_hz if rate_hz >= self.SLOWEST_HZ else 0.0
        elif self._time_ns is not None:
            self._rate_hz = 0.0
        self._phase, self._time_ns = phase, time_ns

    def phase(self, time_ns: int) -> float | None:
        """Phase at a time, ns, 0 to 1; None: not received lately, or it stands still."""
        if self._time_ns is None or self._rate_hz <= 0.0:
            return None
        since_s = (time_ns - self._time_ns) / NANOSECONDS_PER_SECOND
        if abs(since_s) >= self.SILENT_S:
            return None
        return (self._phase + since_s * self._rate_hz) % 1.0

    def forget(self) -> None:
        """Forget when a phase was received: the clock was set back."""
        self._time_ns = None
        self._rate_hz = 0.0

    def touchdown_ns(self, time_ns: int) -> int | None:
        """When the foot will touch down next, ns: as planned, less what steps before were early; None: not known."""
        phase = self.phase(time_ns)
        if phase is None:
            return None
        return time_ns + round(((1.0 - phase) / self._rate_hz - self._early_s) * NANOSECONDS_PER_SECOND)

    def feel(self, time_ns: int) -> None:
        """Take a touch-down that was felt: toes hang lower than planned, and touch early."""
        phase = self.phase(time_ns)
        if phase is None:
            return
        early_s = ((1.0 - phase) if phase > 0.5 else -phase) / self._rate_hz  # noqa: PLR2004 - the nearer one
        if abs(early_s) < NEAR_TOUCHDOWN / self._rate_hz:
            self._early_s += EARLY_SHARE * (early_s - self._early_s)


LOADED_SHARE = 0.4
UNLOADED_SHARE = 0.15
"""Shares of the usual load of a stance above and below which the foot stands and does not: Schmitt's trigger."""
LOAD_MEMORY_S = 2.0
"""Time constant of the usual load, s, in which only a foot that stands counts: some strides."""
LOAD_CONFIRM_S = 0.02
"""A load must be so long on one side, s: a hard landing bounces for some ms."""
LOAD_FORGOTTEN_S = 60.0
"""Time constant, s, in which a usual load fades that the foot does not come near to, as of readings that were wrong.
Chosen: many swings, which are loads of 0, too."""
FADED_SHARE = 0.1
"""Share of it that stays, so that a robot which hangs for minutes is not taken to stand by the cell's noise."""
LOAD_JUMP = 10.0
"""A reading counts as this many usual loads at the most, so that one that is wrong does not set the usual one."""
FIRST_LOADS = 3
"""Readings whose median is the first usual load."""
LEAST_LOAD_N = 1.0
"""A cell that never reads more says nothing of contact, N."""
SILENT_S = 0.5
"""An input that was not received for so long is not there, s."""
PLAN_SILENT_S = 2.0
"""The same for planned contact, s: a gait may publish it on change only, and a stance or swing of a walk is shorter."""
EARLY_SHARE = 0.3
"""Weight of the latest step in how early the feet touch."""
NEAR_TOUCHDOWN = 0.2
"""An impact on the body at another phase than within this of touch-down is another foot's; a fifth of the stride."""
PLANNED_PROBABILITY = 0.9
"""Assumed, of what a plan says: a gait misses its plan on stairs and holes."""


class AnkleAngles(NamedTuple):
    """Roll and pitch of the ankle, rad; what is no number is not measured."""

    roll_rad: float
    pitch_rad: float


class Input(enum.Enum):
    """What may be received."""

    CONTACT_SWITCH = "contact switch"
    LOAD = "load"
    GAIT_PHASE = "gait phase"
    PLANNED_CONTACT = "planned contact"
    JOINTS = "joint states"
    EFFORTS = "joint efforts"
    ANKLE = "ankle angles"
    ODOMETRY = "odometry"


_SAYS = {
    Input.CONTACT_SWITCH: (Source.CONTACT_SWITCH, 1.0),
    Input.LOAD: (Source.LOAD, 1.0),
    Input.PLANNED_CONTACT: (Source.GAIT, PLANNED_PROBABILITY),
    Input.GAIT_PHASE: (Source.GAIT, PLANNED_PROBABILITY),
}
"""Source and probability of the events of what says itself whether the foot stands."""
LEG_SENSORS = (Input.ANKLE, Input.EFFORTS)
"""What feels every step of a foot by itself, the surer first: a toe that grazes the ground makes an effort, too."""


class ContactInputs:
    """Keeps the latest of every input and turns changes of contact into events."""

    def __init__(self, parameters: ControllerParameters) -> None:
        """Have received nothing, and know no leg."""
        self.parameters = parameters
        self.gait = GaitPhase()
        self.roll_rad: float | None = None
        self._pitch_rad = parameters.hang_pitch_rad
        self._pull_n: float | None = None
        self._pull_ns = 0
        self._received_ns: dict[Input, int] = {}
        self._in_contact: dict[Input, bool] = {}
        self._usual_load_n = 0.0
        self._loads_n: deque[float] = deque(maxlen=FIRST_LOADS)
        self._loads = 0
        self._borne_n = 0.0
        self._load_side: bool | None = None
        self._load_side_ns = 0
        self._paired_ns: int | None = None
        self._leg_load: LegLoad | None = None
        self._leg_contact = LoadContact()
        self._ankle_contact = AnkleContact(parameters.hang_pitch_rad) if parameters.takes_blows else None
        self.sole: SoleSlip | None = None

    def know(self, leg: Leg) -> None:
        """Take what the leg is: without it, efforts and odometry say nothing."""
        if self.parameters.use_efforts:
            self._leg_load = LegLoad(leg, self.parameters.armature_kg_m2)
        if self.parameters.use_odometry:
            self.sole = SoleSlip(leg, self.parameters)

    def configure(self, parameters: ControllerParameters) -> None:
        """Take new parameters and go on from the present state."""
        self.parameters = parameters
        if self.sole is not None:
            self.sole.parameters = parameters

    def received(self, time_ns: int) -> tuple[Input, ...]:
        """Inputs that were received lately; a switch counts for ever, as it may publish on change only."""
        return tuple(each for each in self._received_ns if self._is_recent(each, time_ns))

    def measured_contact(self, time_ns: int) -> bool | None:
        """Whether a sensor of contact says that the foot stands; None: there is none."""
        return self._said_by(self.contact_sensor(time_ns))

    def contact_sensor(self, time_ns: int) -> Input | None:
        """Which sensor of contact is believed now; None: there is none."""
        return self._first((Input.CONTACT_SWITCH, Input.LOAD, *LEG_SENSORS), time_ns)

    def planned_contact(self, time_ns: int) -> bool | None:
        """Whether the gait plans contact now; None: no gait is received."""
        return self._said_by(self._first((Input.PLANNED_CONTACT, Input.GAIT_PHASE), time_ns))

    def leg_contact(self, time_ns: int) -> bool | None:
        """Whether the ankle's angles, or else the efforts of the leg, say that the foot stands; None: neither does."""
        return self._said_by(self._first(LEG_SENSORS, time_ns))

    def _first(self, inputs: Sequence[Input], time_ns: int) -> Input | None:
        return next((each for each in inputs if each in self._in_contact and self._is_recent(each, time_ns)), None)

    def _said_by(self, which: Input | None) -> bool | None:
        return None if which is None else self._in_contact[which]

    def shows_contact(self, time_ns: int) -> bool:
        """Whether anything beside the IMU shows contact."""
        return self.planned_contact(time_ns) is not None or self.measured_contact(time_ns) is not None

    def on_input(self, which: Input, value: float, time_ns: int) -> ContactEvent | None:
        """Take the value of a switch, a load or a gait."""
        if which is Input.LOAD:
            return self._on_load(value, time_ns)
        if which is Input.GAIT_PHASE:
            return self._on_phase(value, time_ns)
        return self._change(which, time_ns, contact=bool(value))

    def _on_load(self, load_n: float, time_ns: int) -> ContactEvent | None:
        """Take the load on the foot, N, positive; a leg that hangs on the cell of its rig pulls, without `use_load`."""
        if not math.isfinite(load_n):
            return None
        self._pull_n, self._pull_ns = -load_n, time_ns
        if not self.parameters.use_load:
            return None
        before_ns = self._received_ns.get(Input.LOAD, time_ns)
        elapsed_s = max(0.0, (time_ns - before_ns) / NANOSECONDS_PER_SECOND)
        self._received_ns[Input.LOAD] = time_ns
        self._loads_n.append(load_n)
        self._loads += 1
        before_n = self._usual_load_n
        if self._loads <= FIRST_LOADS or self._usual_load_n < LEAST_LOAD_N:
            self._usual_load_n = max(0.0, statistics.median(self._loads_n))
        elif load_n > UNLOADED_SHARE * self._usual_load_n:
            counted_n = min(load_n, LOAD_JUMP * self._usual_load_n)
            self._usual_load_n += (counted_n - self._usual_load_n) * elapsed_s / (elapsed_s + LOAD_MEMORY_S)
        else:
            faded_n = self._usual_load_n * math.exp(-elapsed_s / LOAD_FORGOTTEN_S)
            self._usual_load_n = max(faded_n, FADED_SHARE * self._borne_n, LEAST_LOAD_N)
        if self._usual_load_n >= before_n:
            self._borne_n = self._usual_load_n
        if self._usual_load_n < LEAST_LOAD_N:
            return None
        share = load_n / self._usual_load_n
        stands = share >= LOADED_SHARE
        if UNLOADED_SHARE < share < LOADED_SHARE or stands is not self._load_side:
            self._load_side, self._load_side_ns = stands, time_ns
            return None
        if (time_ns - self._load_side_ns) / NANOSECONDS_PER_SECOND < LOAD_CONFIRM_S:
            return None
        return self._change(Input.LOAD, time_ns, contact=stands)

    def _on_phase(self, phase: float, time_ns: int) -> ContactEvent | None:
        """Take the gait's phase: 0 at touch-down, 1 at the next.

        While the gait says itself when it plans contact, the share of the stride that the foot stands is not asked.
        """
        if not 0.0 <= phase <= 1.0:
            return None
        self.gait.on_phase(phase, time_ns)
        change = self._change(Input.GAIT_PHASE, time_ns, contact=phase < self.parameters.stance_share)
        return None if self._is_recent(Input.PLANNED_CONTACT, time_ns) else change

    def on_angles(self, angles: AnkleAngles, time_ns: int) -> None:
        """Take roll and pitch of the ankle."""
        if math.isfinite(angles.roll_rad):
            self._received_ns[Input.JOINTS] = time_ns
            self.roll_rad = angles.roll_rad
        if math.isfinite(angles.pitch_rad):
            self._pitch_rad = angles.pitch_rad

    def deflection_rad(self, time_ns: int) -> float:
        """How far roll and pitch of the ankle are from where a soft ankle hangs, rad; 0 where they are not received."""
        if self.roll_rad is None or not self.shows_angles(time_ns):
            return 0.0
        return math.hypot(self.roll_rad, self._pitch_rad - self.parameters.hang_pitch_rad)

    def shows_angles(self, time_ns: int) -> bool:
        """Whether roll and pitch of the ankle are received."""
        return self._is_recent(Input.JOINTS, time_ns)

    @property
    def usual_load_n(self) -> float:
        """What the foot usually bears in a stance, N, by load or efforts; 0: not known."""
        return max(self._usual_load_n, self._leg_contact.usual_n)

    def hangs(self, time_ns: int) -> bool | None:
        """Whether, at rest, the leg hangs on its load cell or presses on the ground; None: there is none that says."""
        lately = abs(time_ns - self._pull_ns) < SILENT_S * NANOSECONDS_PER_SECOND
        if self.parameters.use_load or self._pull_n is None or not lately or abs(self._pull_n) < LEAST_LOAD_N:
            return None
        return self._pull_n > 0.0

    def on_leg(self, reading: LegReading, time_ns: int, *, falls: bool = False) -> ContactEvent | None:
        """Take angles, rates and efforts of hip and knee; of a body that falls: nothing carries it."""
        load_n = None if self._leg_load is None else self._leg_load.update(reading, time_ns)
        if load_n is None:
            return None
        self._received_ns[Input.EFFORTS] = time_ns
        change = self._leg_contact.update(load_n, time_ns, falls=falls)
        if self._leg_contact.stands is not None:
            self._in_contact[Input.EFFORTS] = self._leg_contact.stands
        ankle_knows_better = Input.ANKLE in self._in_contact and self._is_recent(Input.ANKLE, time_ns)
        return None if ankle_knows_better else change

    def forget(self) -> None:
        """Forget when anything was received: the clock was set back. A switch counts until it says something else."""
        self._received_ns = {each: 0 for each in self._received_ns if each is Input.CONTACT_SWITCH}
        self.gait.forget()

    def fly(self) -> None:
        """Take that the body falls: the foot does not stand, whatever a jammed ankle keeps of its last stance."""
        if self._ankle_contact is not None:
            self._ankle_contact.stands = False
            self._in_contact[Input.ANKLE] = False

    def on_ankle(self, reading: AnkleReading, time_ns: int) -> ContactEvent | None:
        """Take angles and rates of the ankle, where its foot hangs toe-down."""
        if self._ankle_contact is None or not all(map(math.isfinite, reading)):
            return None
        self._received_ns[Input.ANKLE] = time_ns
        change = self._ankle_contact.update(reading, time_ns)
        if self._ankle_contact.stands is not None:
            self._in_contact[Input.ANKLE] = self._ankle_contact.stands
        return change

    def on_pose(self, pose: LegPose, time_ns: int, *, stands: bool | None) -> ContactEvent | None:
        """Take angles and rates from the body down to the foot, and whether the foot stands, as far as known."""
        return None if self.sole is None else self._note_sole(self.sole.on_pose(pose, time_ns, stands=stands), time_ns)

    def on_odometry(self, twist: BodyTwist, time_ns: int) -> ContactEvent | None:
        """Take how the body moves, as reported at a time: its own stamp may be earlier."""
        return None if self.sole is None else self._note_sole(self.sole.on_twist(twist, time_ns), time_ns)

    def shows_slips(self, time_ns: int) -> bool:
        """Whether odometry and joints show how fast the sole goes, so that the IMU is not asked for slips."""
        return self._is_recent(Input.ODOMETRY, time_ns)

    def _note_sole(self, slip: ContactEvent | None, time_ns: int) -> ContactEvent | None:
        """Note that the odometry is received: once it has given a speed of the sole."""
        if self.sole is not None and self.sole.paired_ns not in {None, self._paired_ns}:
            self._paired_ns = self.sole.paired_ns
            self._received_ns[Input.ODOMETRY] = time_ns
        return slip

    def is_another_foots(self, time_ns: int) -> bool:
        """Whether a blow on the body comes at a phase at which this foot does not touch down."""
        phase = self.gait.phase(time_ns)
        return phase is not None and NEAR_TOUCHDOWN < phase < 1.0 - NEAR_TOUCHDOWN

    def _is_recent(self, which: Input, time_ns: int) -> bool:
        at_ns = self._received_ns.get(which)
        if at_ns is None or which is Input.CONTACT_SWITCH:
            return at_ns is not None
        silent_s = PLAN_SILENT_S if which is Input.PLANNED_CONTACT else SILENT_S
        return abs(time_ns - at_ns) < silent_s * NANOSECONDS_PER_SECOND

    def _change(self, which: Input, time_ns: int, *, contact: bool) -> ContactEvent | None:
        self._received_ns[which] = time_ns
        before = self._in_contact.get(which)
        self._in_contact[which] = contact
        if before is None or before is contact:
            return None
        source, probability = _SAYS[which]
        return ContactEvent(CHANGES[contact], time_ns, 1.0, NO_UNIT, 0.0, probability, source)
