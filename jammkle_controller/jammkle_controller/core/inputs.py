"""What a robot may tell of contact beside the IMU, each optional: switch, load, gait, joints, efforts, odometry."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from jammkle_common.constants import NANOSECONDS_PER_SECOND
from jammkle_controller.core.anticipation import GaitPhase
from jammkle_controller.core.contact_load import LoadContact
from jammkle_controller.core.events import NEWTON, NO_UNIT, ContactEvent, ContactKind, Source
from jammkle_controller.core.leg_load import LegLoad
from jammkle_controller.core.sole_slip import SoleSlip

if TYPE_CHECKING:
    from jammkle_controller.core.leg_load import LegModel, LegReading
    from jammkle_controller.core.sole_slip import SoleSettings
    from jammkle_controller.core.sole_speed import BodyTwist, LegPose

LOADED_SHARE = 0.4
UNLOADED_SHARE = 0.15
"""Shares of the usual load of a stance above and below which the foot stands and does not: Schmitt's trigger."""
LOAD_MEMORY_S = 2.0
"""Time constant of the usual load, s, in which only a foot that stands counts: some strides."""
LOAD_CONFIRM_S = 0.02
"""A load must be so long on one side, s: a hard landing bounces for some ms."""
LEAST_LOAD_N = 1.0
"""A cell that never reads more says nothing of contact, N."""
SILENT_S = 0.5
"""An input that was not heard for so long is not there, s."""
PLAN_SILENT_S = 2.0
"""The same for planned contact, s: a gait may tell it on change only, and a stance or swing of a walk is shorter."""
NEAR_TOUCHDOWN = 0.2
"""An impact on the body at another phase than within this of touch-down is another foot's; a fifth of the stride."""
PLANNED_PROBABILITY = 0.9
"""Assumed, of what a plan says: a gait misses its plan on stairs and holes."""


class Input(enum.Enum):
    """What may be heard."""

    CONTACT_SWITCH = "contact switch"
    LOAD = "load"
    GAIT_PHASE = "gait phase"
    PLANNED_CONTACT = "planned contact"
    JOINTS = "joint states"
    EFFORTS = "joint efforts"
    ODOMETRY = "odometry"


@dataclass(frozen=True)
class InputSettings:
    """Share of the stride that the foot stands, whether the load cell shows contact, and what the leg is, if known.

    `sole` is how the speed of its sole follows from odometry and joints; None: no odometry is heard.
    """

    stance_share: float
    use_load: bool
    leg: LegModel | None = None
    sole: SoleSettings | None = None


class ContactInputs:
    """Keeps the latest of every input and turns changes of contact into events."""

    def __init__(self, settings: InputSettings) -> None:
        """Hear nothing."""
        self.settings = settings
        self.gait = GaitPhase()
        self.roll_rad: float | None = None
        self._pitch_rad = 0.0
        self._pull_n: float | None = None
        self._pull_ns = 0
        self._heard_ns: dict[Input, int] = {}
        self._in_contact: dict[Input, bool] = {}
        self._usual_load_n = 0.0
        self._load_side: bool | None = None
        self._load_side_ns = 0
        self._paired_ns: int | None = None
        self._leg_load = None if settings.leg is None else LegLoad(settings.leg)
        self._leg_contact = LoadContact()
        self.sole = None if settings.sole is None else SoleSlip(settings.sole)

    def heard(self, time_ns: int) -> tuple[Input, ...]:
        """Inputs that were heard lately; a switch is heard for ever, as it may speak on change only."""
        return tuple(each for each in self._heard_ns if self._is_heard(each, time_ns))

    def measured_contact(self, time_ns: int) -> bool | None:
        """Whether a sensor of contact says that the foot stands; None: there is none."""
        shown_by = self.contact_sensor(time_ns)
        return None if shown_by is None else self._in_contact[shown_by]

    def contact_sensor(self, time_ns: int) -> Input | None:
        """Which sensor of contact is believed now; None: there is none."""
        here = self.heard(time_ns)
        for each in (Input.CONTACT_SWITCH, Input.LOAD, Input.EFFORTS):
            if each in here and each in self._in_contact:
                return each
        return None

    def planned_contact(self, time_ns: int) -> bool | None:
        """Whether the gait plans contact now; None: no gait is heard."""
        for each in (Input.PLANNED_CONTACT, Input.GAIT_PHASE):
            if self._is_heard(each, time_ns):
                return self._in_contact[each]
        return None

    def efforts_contact(self, time_ns: int) -> bool | None:
        """Whether the efforts of the leg say that the foot stands; None: they are not heard."""
        return self._in_contact.get(Input.EFFORTS) if self._is_heard(Input.EFFORTS, time_ns) else None

    def tells_contact(self, time_ns: int) -> bool:
        """Whether anything beside the IMU shows contact."""
        planned = {Input.GAIT_PHASE, Input.PLANNED_CONTACT} & set(self.heard(time_ns))
        return bool(planned) or self.measured_contact(time_ns) is not None

    def hear_switch(self, *, closed: bool, time_ns: int) -> ContactEvent | None:
        """Take a contact switch."""
        return self._change(Input.CONTACT_SWITCH, Source.CONTACT_SWITCH, time_ns, 1.0, contact=closed)

    def hear_plan(self, *, contact: bool, time_ns: int) -> ContactEvent | None:
        """Take whether the gait plans contact now."""
        return self._change(Input.PLANNED_CONTACT, Source.GAIT, time_ns, PLANNED_PROBABILITY, contact=contact)

    def hear_load(self, load_n: float, time_ns: int) -> ContactEvent | None:
        """Take the load on the foot, N, positive."""
        if not self.settings.use_load or not math.isfinite(load_n):
            return None
        before_ns = self._heard_ns.get(Input.LOAD, time_ns)
        elapsed_s = max(0.0, (time_ns - before_ns) / NANOSECONDS_PER_SECOND)
        self._heard_ns[Input.LOAD] = time_ns
        if self._usual_load_n == 0.0:
            self._usual_load_n = max(0.0, load_n)
        if load_n > UNLOADED_SHARE * self._usual_load_n:
            self._usual_load_n += (load_n - self._usual_load_n) * elapsed_s / (elapsed_s + LOAD_MEMORY_S)
        if self._usual_load_n < LEAST_LOAD_N:
            return None
        share = load_n / self._usual_load_n
        stands = share >= LOADED_SHARE
        if UNLOADED_SHARE < share < LOADED_SHARE or stands is not self._load_side:
            self._load_side, self._load_side_ns = stands, time_ns
            return None
        if (time_ns - self._load_side_ns) / NANOSECONDS_PER_SECOND < LOAD_CONFIRM_S:
            return None
        return self._change(Input.LOAD, Source.LOAD, time_ns, 1.0, contact=stands)

    def hear_phase(self, phase: float, time_ns: int) -> ContactEvent | None:
        """Take the gait's phase: 0 at touch-down, 1 at the next.

        While the gait says itself when it plans contact, the share of the stride that the foot stands is not asked.
        """
        if not 0.0 <= phase <= 1.0:
            return None
        self.gait.hear(phase, time_ns)
        stands = phase < self.settings.stance_share
        change = self._change(Input.GAIT_PHASE, Source.GAIT, time_ns, PLANNED_PROBABILITY, contact=stands)
        return None if self._is_heard(Input.PLANNED_CONTACT, time_ns) else change

    def hear_joints(self, roll_rad: float, time_ns: int) -> None:
        """Take the ankle's roll, rad."""
        if math.isfinite(roll_rad):
            self._heard_ns[Input.JOINTS] = time_ns
            self.roll_rad = roll_rad

    def hear_pitch(self, pitch_rad: float) -> None:
        """Take the ankle's pitch, rad, that comes with its roll."""
        if math.isfinite(pitch_rad):
            self._pitch_rad = pitch_rad

    def deflection_rad(self, time_ns: int) -> float:
        """How far roll and pitch of the ankle are from where a soft ankle hangs, rad; 0 where they are not heard."""
        if self.roll_rad is None or not self._is_heard(Input.JOINTS, time_ns):
            return 0.0
        return math.hypot(self.roll_rad, self._pitch_rad)

    def hear_pull(self, pull_n: float, time_ns: int) -> None:
        """Take the tension of a load cell that the leg hangs on in a rig, N; what presses is negative."""
        if math.isfinite(pull_n):
            self._pull_n, self._pull_ns = pull_n, time_ns

    def hangs(self, time_ns: int) -> bool | None:
        """Whether, at rest, the leg hangs on its load cell or presses on the ground; None: there is none that says."""
        lately = abs(time_ns - self._pull_ns) < SILENT_S * NANOSECONDS_PER_SECOND
        if self.settings.use_load or self._pull_n is None or not lately or abs(self._pull_n) < LEAST_LOAD_N:
            return None
        return self._pull_n > 0.0

    def hear_leg(self, reading: LegReading, time_ns: int, *, falls: bool = False) -> ContactEvent | None:
        """Take angles, rates and efforts of hip and knee; of a body that falls: nothing carries it."""
        load_n = None if self._leg_load is None else self._leg_load.update(reading, time_ns)
        if load_n is None:
            return None
        self._heard_ns[Input.EFFORTS] = time_ns
        change = self._leg_contact.update(0.0 if falls else load_n, time_ns)
        if self._leg_contact.stands is not None:
            self._in_contact[Input.EFFORTS] = self._leg_contact.stands
        if change is None:
            return None
        kind = ContactKind.IMPACT if change.stands else ContactKind.LIFTOFF
        return ContactEvent(kind, time_ns, load_n, NEWTON, change.delay_s, change.probability, Source.EFFORTS)

    def hear_pose(self, pose: LegPose, time_ns: int, *, stands: bool | None) -> ContactEvent | None:
        """Take angles and rates from the body down to the foot, and whether the foot stands, as far as known."""
        return (
            None if self.sole is None else self._note_sole(self.sole.hear_pose(pose, time_ns, stands=stands), time_ns)
        )

    def hear_odometry(self, twist: BodyTwist, time_ns: int) -> ContactEvent | None:
        """Take how the body moves, as it is told at a time: its own stamp may be earlier."""
        return None if self.sole is None else self._note_sole(self.sole.hear_twist(twist, time_ns), time_ns)

    def tells_slips(self, time_ns: int) -> bool:
        """Whether odometry and joints tell how fast the sole goes, so that the IMU is not asked for slips."""
        return self._is_heard(Input.ODOMETRY, time_ns)

    def _note_sole(self, slip: ContactEvent | None, time_ns: int) -> ContactEvent | None:
        """Note that the odometry is heard: once it has told a speed of the sole."""
        if self.sole is not None and self.sole.paired_ns is not None:
            if self.sole.paired_ns != self._paired_ns:
                self._heard_ns[Input.ODOMETRY] = time_ns
            self._paired_ns = self.sole.paired_ns
        return slip

    def is_another_foots(self, time_ns: int) -> bool:
        """Whether a blow on the body comes at a phase at which this foot does not touch down."""
        phase = self.gait.phase(time_ns)
        return phase is not None and NEAR_TOUCHDOWN < phase < 1.0 - NEAR_TOUCHDOWN

    def _is_heard(self, which: Input, time_ns: int) -> bool:
        at_ns = self._heard_ns.get(which)
        if at_ns is None or which is Input.CONTACT_SWITCH:
            return at_ns is not None
        silent_s = PLAN_SILENT_S if which is Input.PLANNED_CONTACT else SILENT_S
        return abs(time_ns - at_ns) < silent_s * NANOSECONDS_PER_SECOND

    def _change(
        self, which: Input, source: Source, time_ns: int, probability: float, *, contact: bool
    ) -> ContactEvent | None:
        self._heard_ns[which] = time_ns
        before = self._in_contact.get(which)
        self._in_contact[which] = contact
        if before is None or before is contact:
            return None
        kind = ContactKind.IMPACT if contact else ContactKind.LIFTOFF
        return ContactEvent(kind, time_ns, 1.0, NO_UNIT, 0.0, probability, source)
