"""One IMU sample, which samples of a stream may be used, and whether the IMU can be believed at all."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from jammkle_common.constants import NANOSECONDS_PER_SECOND, STANDARD_GRAVITY_M_S2

if TYPE_CHECKING:
    from jammkle_controller.parameters import ControllerParameters

REORDERING_LIMIT_S = 0.1
"""A stamp further back than this is a new time line, not a late sample (assumed: ten times the worst jitter seen)."""

LONGEST_GAP_S = 0.1
"""Longest interval between two samples that are still compared, s."""

LARGEST_FORCE_M_S2 = 4000.0
"""A reading beyond it is none, m/s^2: 400 g, the widest range of small accelerometers (H3LIS331DL)."""

LARGEST_RATE_RAD_S = 350.0
"""As above for the gyro, rad/s: 20,000 deg/s (ADXRS649). Readings in deg/s of a gyro of common range pass it often."""

_RATE_FORGETTING = 0.02


class ImuSample(NamedTuple):
    """One sample: when, specific force in m/s^2 and angular velocity in rad/s, both in the IMU's own frame.

    The time is whole nanoseconds of header.stamp, so that a shift of the clock changes no interval.
    """

    time_ns: int
    force_x: float
    force_y: float
    force_z: float
    rate_x: float
    rate_y: float
    rate_z: float

    def scaled(self, force: float, rate: float) -> ImuSample:
        """Return the sample with its forces and rates multiplied, as where they are of another unit."""
        forces, rates = (self.force_x, self.force_y, self.force_z), (self.rate_x, self.rate_y, self.rate_z)
        return ImuSample(self.time_ns, *(force * each for each in forces), *(rate * each for each in rates))


class Admission(enum.Enum):
    """What the gate says of a sample."""

    USABLE = "usable"
    """It follows the last one."""
    AFTER_GAP = "after a gap"
    """It may be used, but what came before is too old to compare it with. The first sample of all is one of these."""
    RESTARTED = "restarted"
    """Its stamp lies far behind the last one: the clock, or the simulation, was restarted."""
    HELD = "held"
    """Its stamp is new and its values are those of the last one, to the last bit: the source repeats a reading until
    the next comes. It gives the time and nothing else."""
    NOT_FINITE = "not finite"
    """It holds NaN or infinity; ignored."""
    OUT_OF_RANGE = "out of range"
    """It holds a value that no sensor gives; ignored."""
    REPEATED = "repeated"
    """Its stamp is that of the last sample; ignored."""
    LATE = "late"
    """Its stamp lies a little behind the last one (delivered out of order); ignored."""


BAD = frozenset({Admission.NOT_FINITE, Admission.OUT_OF_RANGE, Admission.REPEATED, Admission.LATE})
"""Samples that are not what a sensor in order sends."""

IGNORED = BAD | {Admission.HELD}
"""Samples that must not reach a detector."""


@dataclass(frozen=True)
class StreamCounts:
    """What has come in so far, in samples."""

    usable: int = 0
    held: int = 0
    not_finite: int = 0
    out_of_range: int = 0
    repeated: int = 0
    late: int = 0
    gaps: int = 0
    restarts: int = 0

    @property
    def ignored(self) -> int:
        """Samples that were not used."""
        return self.not_finite + self.out_of_range + self.repeated + self.late


class ImuGate:
    """Admits samples by their stamps and values, and counts what it saw."""

    def __init__(self) -> None:
        """Make a gate that has seen nothing; `last_ns` is then the stamp of the last sample that gave a time, ns."""
        self.interval_s = 0.0
        self._mean_interval_s = self._mean_stamps_s = 0.0
        self.last_ns: int | None = None
        self._used_ns = 0
        self._last_values: tuple[float, ...] = ()
        self._counts = dict.fromkeys(Admission, 0)

    def admit(self, sample: ImuSample) -> Admission:
        """Judge the next sample; `interval_s` is then the time since the usable one before it, in s."""
        # One NaN or infinity makes the sum NaN or infinite: one test instead of six.
        if not math.isfinite(sum(sample)):
            admission = Admission.NOT_FINITE
        elif not _is_possible(sample):
            admission = Admission.OUT_OF_RANGE
        else:
            admission = self._judge_time(sample)
        self._counts[admission] += 1
        return admission

    def _judge_time(self, sample: ImuSample) -> Admission:
        time_ns = sample.time_ns
        if self.last_ns is None:
            return self._use(sample, Admission.AFTER_GAP)
        since_last_s = (time_ns - self.last_ns) / NANOSECONDS_PER_SECOND
        if since_last_s < -REORDERING_LIMIT_S:
            return self._use(sample, Admission.RESTARTED)
        if since_last_s <= 0.0:
            return Admission.LATE if since_last_s < 0.0 else Admission.REPEATED
        if since_last_s <= LONGEST_GAP_S:
            self._mean_stamps_s = _mean(self._mean_stamps_s, since_last_s)
        if sample[1:] == self._last_values:
            self.last_ns = time_ns
            return Admission.HELD
        self.interval_s = interval_s = (time_ns - self._used_ns) / NANOSECONDS_PER_SECOND
        if interval_s > LONGEST_GAP_S:
            return self._use(sample, Admission.AFTER_GAP)
        self._mean_interval_s = _mean(self._mean_interval_s, interval_s)
        return self._use(sample, Admission.USABLE)

    def _use(self, sample: ImuSample, admission: Admission) -> Admission:
        self.last_ns = self._used_ns = sample.time_ns
        self._last_values = sample[1:]
        return admission

    def count(self, admission: Admission) -> int:
        """Samples of which the gate said this."""
        return self._counts[admission]

    @property
    def rate_hz(self) -> float:
        """Recent rate of usable samples, without held ones, by their stamps, Hz; 0 before there are two."""
        return 1.0 / self._mean_interval_s if self._mean_interval_s > 0.0 else 0.0

    @property
    def published_hz(self) -> float:
        """Recent rate of new stamps, held readings among them, Hz; 0 before there are two."""
        return 1.0 / self._mean_stamps_s if self._mean_stamps_s > 0.0 else 0.0

    @property
    def counts(self) -> StreamCounts:
        """What has come in so far."""
        counts = self._counts
        return StreamCounts(
            usable=counts[Admission.USABLE] + counts[Admission.AFTER_GAP] + counts[Admission.RESTARTED],
            held=counts[Admission.HELD],
            not_finite=counts[Admission.NOT_FINITE],
            out_of_range=counts[Admission.OUT_OF_RANGE],
            repeated=counts[Admission.REPEATED],
            late=counts[Admission.LATE],
            gaps=max(0, counts[Admission.AFTER_GAP] - 1),
            restarts=counts[Admission.RESTARTED],
        )


def _mean(before_s: float, interval_s: float) -> float:
    """Return the mean with one interval more; the first is the mean itself, or a rate would begin much too high."""
    return interval_s if before_s == 0.0 else before_s + (interval_s - before_s) * _RATE_FORGETTING


def _is_possible(sample: ImuSample) -> bool:
    """Whether there is a sensor that can read this."""
    _, x, y, z, p, q, r = sample
    return max(x, y, z, -x, -y, -z) <= LARGEST_FORCE_M_S2 and max(p, q, r, -p, -q, -r) <= LARGEST_RATE_RAD_S


CHECK_S = 0.02
"""How long a new stream is looked at before it is believed, s: a fall of 2 mm, and enough to see gravity."""

RECOVER_S = 0.5
"""Time for which an IMU must be in order before it is believed again, s. Assumed."""

LEVEL_TIME_S = 1.0
"""Time constant of the mean |specific force|, s. In free fall from rest it needs 0.7 s, a fall of 2.4 m, to halve."""

LEAST_LEVEL_M_S2 = 0.5 * STANDARD_GRAVITY_M_S2
"""Least mean |specific force| of a body that stands or walks, m/s^2. In one that keeps its height the vertical
specific force has the mean g, so the magnitude has at least that. Readings in g give 1."""

STEPPED_SAMPLES = 2
"""As many readings that a step has left below `LEAST_LEVEL_M_S2` are one, before the three that make a flight."""
UNIT_M_S2 = 0.2
"""How far readings may be from those before in units of g, m/s^2: the unrest of a body at rest, over 9.8, twice."""
STILL_RAD_S = 0.5
"""Rate below which a body does not turn, rad/s: a foot that leaves the ground turns by several."""

LARGEST_LEVEL_M_S2 = 10.0 * STANDARD_GRAVITY_M_S2
"""Largest mean |specific force|, m/s^2; readings in cm/s^2 or mm/s^2 pass it. Assumed: feet that run reach 5 g."""

DEAD_SAMPLES = 3
"""As many readings of exactly zero on three axes are a dead sensor: in free fall there is noise and bias."""

BAD_MEMORY = 50
"""Samples over which the share of bad ones is counted, good ones and bad ones: by chance that is off by 0.05, so that a
stream with 30 % of them is never taken for one with half, at any rate."""
LARGEST_BAD_SHARE = 0.5
"""More than this share of bad samples leaves gaps longer than an impact."""

CLIP_TIME_S = 0.2
LARGEST_CLIPPED_SHARE = 0.5
"""A sensor that reads the end of its range at every other sample measures nothing; at a touch-down it is for 20 ms."""
CLIPPED_FROM_M_S2 = 1.9 * STANDARD_GRAVITY_M_S2
"""No accelerometer's range is smaller than 2 g."""
CLIP_REPEATS = 3
"""As often an axis must have read its largest value exactly before that is its range."""

TURN_TIME_S = 0.1
"""Time constant of the mean direction that is compared with the gyro, s."""
TURN_FORGETTING_S = 2.0
TURN_EVIDENCE_RAD2_S = 4.0
"""Integral of the squared rate that the gyro claims, from which on it can be judged: 2 rad/s for 1 s."""
MOST_EVIDENCE = 2.0
"""Evidence is remembered up to so many times what is needed: a wrong unit must not outlive itself by its size."""
CLAIM_RAD_S = 0.1
"""Mean rate below which the gyro claims no turning, and so nothing that gravity could contradict, rad/s. Assumed."""
LEAST_TURN_RATIO = 0.15
"""Least share of the claimed turning that gravity must show; deg/s for rad/s shows 1/57."""
LARGEST_OPPOSED_RATIO = -0.5
"""Gravity that turns the other way says that the two sensors are not in one right-handed frame."""
QUIET_M_S2 = 1.0
"""Where | |specific force| - g | stays below it, its direction is that of gravity to 6 deg, and is compared."""

LEAST_RATE_HZ = 50.0
"""Below it an impact can pass between two samples."""
RATE_RATIO = 2.0
"""A measured rate further than this from the configured one is another sensor, or another setting of it."""


class ImuTrouble(enum.Enum):
    """Why an IMU is not believed."""

    CHECKING = "it is looked at first"
    DEAD = "dead: it reads exactly zero"
    FROZEN = "frozen: the same reading over and over"
    TOO_SMALL = "the mean specific force is far below gravity: unit (g for m/s^2?), or gravity was removed"
    TOO_LARGE = "the mean specific force is far above gravity: unit (mm/s^2 for m/s^2?)"
    TURNING = "gravity turns much less than the angular velocity says: unit (deg/s for rad/s?)"
    FRAME = "gravity turns against the angular velocity: the two are not in one right-handed frame"
    BAD_SAMPLES = "too many samples that are not finite, out of range, late or repeated"
    CLIPPED = "at the end of its range most of the time"
    RATE = "its rate is far from the one configured, or too low to see an impact"


_OFF_LEVEL = (ImuTrouble.TOO_SMALL, ImuTrouble.TOO_LARGE)


class ImuWatch:
    """Judges a stream of samples, held and bad ones included, with constant memory."""

    def __init__(self, parameters: ControllerParameters) -> None:
        """Make a watch that has seen nothing."""
        self.parameters = parameters
        self.trouble: ImuTrouble | None = ImuTrouble.CHECKING
        self._begin_ns: int | None = None
        self._believed_once = False
        self._seen: ImuTrouble | None = ImuTrouble.CHECKING
        self._seen_ns = 0
        self._zeros = 0
        self.level_m_s2 = 0.0
        """Mean |specific force|, m/s^2, over about `LEVEL_TIME_S`."""
        self._bad_share = 0.0
        self.clipped_share = 0.0
        """Share of recent samples at the end of the range."""
        self._peak = [0.0, 0.0, 0.0]
        self._peak_repeats = [0, 0, 0]
        self._fresh_ns = 0
        self._before_ns = 0
        self._rates_hz = (0.0, 0.0)
        self._step: tuple[tuple[float, float, float], int] | None = None
        self._after_gap = False
        self._last = (0.0, 0.0, 0.0)
        self._forget_turning()

    def begin_anew(self) -> None:
        """Look at the stream as at a new one: the clock was set back, or it was silent for long."""
        self._begin_ns = None
        self._believed_once = False
        self._forget_turning()

    @property
    def reason(self) -> str:
        """Why it is not believed, with numbers where there are any; empty: it is."""
        if self.trouble is not ImuTrouble.RATE:
            return "" if self.trouble is None else self.trouble.value
        measured_hz, wanted_hz = self._rates_hz[0], self.parameters.imu_rate_hz
        if measured_hz < LEAST_RATE_HZ:
            return (
                f"its rate is {measured_hz:.0f} Hz: below {LEAST_RATE_HZ:.0f} Hz an impact passes between two samples"
            )
        published = f", published at {self._rates_hz[1]:.0f} Hz" if self._rates_hz[1] > RATE_RATIO * measured_hz else ""
        return (
            f"its rate is {measured_hz:.0f} Hz{published}, and imu_rate_hz {wanted_hz:g} Hz: set what it is, or 0 "
            f"for any from {LEAST_RATE_HZ:.0f} Hz"
        )

    def observe(
        self,
        sample: ImuSample,
        admission: Admission,
        rates_hz: tuple[float, float],
        *,
        stands: bool = False,
    ) -> bool:
        """Take the next sample and what the gate said of it; return whether it may be used to detect anything.

        Args:
            sample: The sample.
            admission: What the gate said.
            rates_hz: Of readings that differ, and of stamps, with readings that are repeated, Hz; 0: not known.
            stands: Whether the foot is known to stand.

        """
        if self.trouble is not ImuTrouble.RATE:
            self._rates_hz = rates_hz
        time_ns = sample.time_ns
        if admission in BAD:
            self._bad_share += (1.0 - self._bad_share) / BAD_MEMORY
            if self._bad_share > LARGEST_BAD_SHARE:
                self._note(ImuTrouble.BAD_SAMPLES, max(time_ns, self._before_ns))
            return False
        if self._begin_ns is None:
            self._begin_ns = self._fresh_ns = time_ns
            self.level_m_s2 = math.hypot(sample.force_x, sample.force_y, sample.force_z)
            self._before_ns = time_ns
        interval_s = min(0.1, (time_ns - self._before_ns) / NANOSECONDS_PER_SECOND)
        self._before_ns = time_ns
        self._bad_share -= self._bad_share / BAD_MEMORY
        held = admission is Admission.HELD
        if not held:
            self._fresh_ns = time_ns
            self._look_for_step(sample, stands=stands, after_gap=admission is Admission.AFTER_GAP)
        is_zero = sample.force_x == sample.force_y == sample.force_z == 0.0
        self._zeros = self._zeros + 1 if is_zero else 0
        if self._zeros >= DEAD_SAMPLES:
            seen: ImuTrouble | None = ImuTrouble.DEAD
        else:
            seen = self._held(time_ns) if held else self._fresh(sample, interval_s, rates_hz)
        if seen is None and (time_ns - self._begin_ns) / NANOSECONDS_PER_SECOND < CHECK_S:
            seen = ImuTrouble.CHECKING
        if seen is not None:
            self._note(seen, time_ns)
        elif self._seen is not None:
            self._believe_again(time_ns)
        return self.trouble is None and not held

    def _believe_again(self, time_ns: int) -> None:
        """Believe what was wrong a moment ago once it has been right for a while."""
        quarantine_s = RECOVER_S if self._believed_once else 0.0
        if (time_ns - self._seen_ns) / NANOSECONDS_PER_SECOND >= quarantine_s:
            if self.trouble in (ImuTrouble.TURNING, ImuTrouble.FRAME):
                self._forget_turning()
            self._seen = self.trouble = None
            self._believed_once = True

    def _note(self, trouble: ImuTrouble, time_ns: int) -> None:
        self._seen = self.trouble = trouble
        self._seen_ns = time_ns

    def _look_for_step(self, sample: ImuSample, *, stands: bool, after_gap: bool) -> None:
        """Let the mean begin anew where readings at rest step to far below gravity, and no motion explains it.

        Who leaves the ground pushes off, or turns, or is let down over some milliseconds. The foot of a robot that
        stands does not fall from one sample to the next; and nothing that falls reads 1/9.8 of what it read before,
        in whatever frame after a gap, in which an IMU may have been set up anew.
        """
        force = (sample.force_x, sample.force_y, sample.force_z)
        last, self._last = self._last, force
        if math.hypot(*force) >= LEAST_LEVEL_M_S2 or math.hypot(*sample[4:]) >= STILL_RAD_S:
            self._step = None
            return
        if self._step is None:
            rests = self._unrest_m_s2 < QUIET_M_S2
            if rests and self._direction and abs(math.hypot(*last) - STANDARD_GRAVITY_M_S2) < QUIET_M_S2:
                self._step, self._after_gap = (last, 1), after_gap
            return
        before, samples = self._step
        self._step = (before, samples + 1)
        expected = [each / STANDARD_GRAVITY_M_S2 for each in before]
        in_g = math.dist(force, expected) < UNIT_M_S2
        in_g = in_g or (self._after_gap and abs(math.hypot(*force) - math.hypot(*expected)) < UNIT_M_S2)
        if samples + 1 == STEPPED_SAMPLES and self._believed_once and (stands or in_g):
            self.level_m_s2 = math.hypot(*force)

    def _held(self, time_ns: int) -> ImuTrouble | None:
        """Hold on to what was wrong while a reading is merely repeated: it says nothing new."""
        if (time_ns - self._fresh_ns) / NANOSECONDS_PER_SECOND > self.parameters.imu_frozen_s:
            return ImuTrouble.FROZEN
        return None if self._seen is ImuTrouble.CHECKING else self._seen

    def _fresh(self, sample: ImuSample, interval_s: float, rates_hz: tuple[float, float]) -> ImuTrouble | None:
        x, y, z = sample.force_x, sample.force_y, sample.force_z
        force = math.sqrt(x * x + y * y + z * z)
        # A mean of what was seen so far, until it is believed: who begins to look in mid-air has landed soon, and who
        # has stood for a moment may fall.
        seen_s = (sample.time_ns - (self._begin_ns or 0)) / NANOSECONDS_PER_SECOND
        level_time_s = LEVEL_TIME_S if self._believed_once else min(LEVEL_TIME_S, max(CHECK_S, seen_s))
        if self._seen in _OFF_LEVEL and abs(force - STANDARD_GRAVITY_M_S2) < QUIET_M_S2:
            level_time_s = CHECK_S  # it reads gravity again: what it read before says nothing more
        self.level_m_s2 += (force - self.level_m_s2) * interval_s / (interval_s + level_time_s)
        if self.level_m_s2 < LEAST_LEVEL_M_S2:
            return ImuTrouble.TOO_SMALL
        if self.level_m_s2 > LARGEST_LEVEL_M_S2:
            return ImuTrouble.TOO_LARGE
        if self._is_clipped((x, y, z), interval_s):
            return ImuTrouble.CLIPPED
        if self._is_off(rates_hz, seen_s):
            return ImuTrouble.RATE
        return self._turning(sample, force, interval_s)

    def _is_off(self, rates_hz: tuple[float, float], seen_s: float) -> bool:
        """Whether readings are too few, or neither they nor what is published come at the configured rate."""
        if rates_hz[0] <= 0.0 or seen_s < LEVEL_TIME_S:
            return False
        wanted_hz = self.parameters.imu_rate_hz
        fits = any(wanted_hz / RATE_RATIO <= each <= wanted_hz * RATE_RATIO for each in rates_hz)
        return rates_hz[0] < LEAST_RATE_HZ or (wanted_hz > 0.0 and not fits)

    def _is_clipped(self, force: tuple[float, float, float], interval_s: float) -> bool:
        """Learn the range as the largest value that comes again and again exactly, and count what reads it."""
        clipped = False
        for axis, value in enumerate(force):
            size = abs(value)
            if size < CLIPPED_FROM_M_S2:
                continue
            if size > self._peak[axis]:
                self._peak[axis] = size
                self._peak_repeats[axis] = 1
            elif size == self._peak[axis]:
                self._peak_repeats[axis] += 1
            clipped |= size == self._peak[axis] and self._peak_repeats[axis] >= CLIP_REPEATS
        self.clipped_share += (clipped - self.clipped_share) * interval_s / (interval_s + CLIP_TIME_S)
        return self.clipped_share > LARGEST_CLIPPED_SHARE

    def _forget_turning(self) -> None:
        self._direction: tuple[float, float, float] | None = None
        self._claimed = (0.0, 0.0, 0.0)
        self._unrest_m_s2 = 0.0
        self._claimed_squared = 0.0
        self._shown = 0.0

    def _turning(self, sample: ImuSample, force: float, interval_s: float) -> ImuTrouble | None:
        """Compare the turning of gravity with the gyro by the transport theorem, n' = -w x n, both low-passed alike.

        The ratio is the least-squares slope of n' over -w x n, over about `TURN_FORGETTING_S`.
        """
        if force == 0.0:
            return None
        n = (sample.force_x / force, sample.force_y / force, sample.force_z / force)
        w = (sample.rate_x, sample.rate_y, sample.rate_z)
        claim = (n[1] * w[2] - n[2] * w[1], n[2] * w[0] - n[0] * w[2], n[0] * w[1] - n[1] * w[0])
        share = interval_s / (interval_s + TURN_TIME_S)
        self._unrest_m_s2 += (abs(force - STANDARD_GRAVITY_M_S2) - self._unrest_m_s2) * share
        d, c = self._direction or n, self._claimed
        d = (d[0] + (n[0] - d[0]) * share, d[1] + (n[1] - d[1]) * share, d[2] + (n[2] - d[2]) * share)
        c = (c[0] + (claim[0] - c[0]) * share, c[1] + (claim[1] - c[1]) * share, c[2] + (claim[2] - c[2]) * share)
        self._direction, self._claimed = d, c
        claimed_squared = c[0] * c[0] + c[1] * c[1] + c[2] * c[2]
        keep = 1.0 - interval_s / (interval_s + TURN_FORGETTING_S)
        self._claimed_squared *= keep
        self._shown *= keep
        if self._unrest_m_s2 < QUIET_M_S2:
            turns = ((n[0] - d[0]) / TURN_TIME_S, (n[1] - d[1]) / TURN_TIME_S, (n[2] - d[2]) / TURN_TIME_S)
            self._claimed_squared += interval_s * claimed_squared
            self._shown += interval_s * (c[0] * turns[0] + c[1] * turns[1] + c[2] * turns[2])
        most = TURN_EVIDENCE_RAD2_S * MOST_EVIDENCE
        if self._claimed_squared > most:
            self._shown *= most / self._claimed_squared
            self._claimed_squared = most
        if self._claimed_squared < TURN_EVIDENCE_RAD2_S or claimed_squared < CLAIM_RAD_S**2:
            return None
        ratio = self._shown / self._claimed_squared
        if ratio < LARGEST_OPPOSED_RATIO:
            return ImuTrouble.FRAME
        return ImuTrouble.TURNING if ratio < LEAST_TURN_RATIO else None


REMEMBERED_S = 5.0
"""How long trouble in the stream is reported after it ended, s."""


class Freshness:
    """Watches the counts of samples from regular work, so that the samples themselves need not read any clock."""

    def __init__(self, timeout_s: float, now_s: float) -> None:
        """Start watching now.

        Args:
            timeout_s: Silence that makes the stream stale, s.
            now_s: The time that the ankle lives in, s: a paused simulation stops it, and is no fault.

        """
        self._timeout_s = timeout_s
        self._usable = self._troubles = 0
        self._since_s = self._now_s = now_s
        self._irregular_until_s = 0.0

    def observe(self, counts: StreamCounts, now_s: float) -> None:
        """Take the samples counted so far, and the time, s."""
        # A simulated clock reads zero until it first ticks: its first value is no lapse of time.
        clock_starts = self._now_s == 0.0 and now_s > 0.0
        if counts.usable != self._usable or now_s < self._now_s or clock_starts:
            self._usable = counts.usable
            self._since_s = now_s
        troubles = counts.ignored + counts.gaps + counts.restarts
        if troubles != self._troubles:
            self._troubles = troubles
            self._irregular_until_s = now_s + REMEMBERED_S
        self._now_s = now_s

    @property
    def silent_s(self) -> float:
        """Time without a sample, s, as of the last `observe`."""
        return self._now_s - self._since_s

    @property
    def stale(self) -> bool:
        """Whether samples are missing although time goes on."""
        return self.silent_s > self._timeout_s

    @property
    def irregular(self) -> bool:
        """Whether samples were ignored or missing, or the clock was set back, within the last `REMEMBERED_S`."""
        return self._now_s < self._irregular_until_s
