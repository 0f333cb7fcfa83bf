"""The trial of faults as Markdown: a confusion matrix with delays, beside what time-outs alone say."""

from __future__ import annotations

import statistics
from typing import TYPE_CHECKING

from fault_bench import PLACED, WITHIN_S
from jammkle_driver.core.faults import Reason
from studies.faults.trial import REASONS

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from studies.faults.trial import Outcome


def tables(
    outcomes: Sequence[Outcome], by_time_outs: Sequence[Outcome], false_alarms: Sequence[str], hours: float
) -> str:
    """Return the confusion matrix and the delays.

    Args:
        outcomes: What was said of each injection.
        by_time_outs: What a driver that has no law of the air (`diagnose: false`) said of the same: the baseline.
        false_alarms: What was said of healthy ankles.
        hours: How long those were jammed and vented, h.

    """
    placed = sum(each.injected in PLACED for each in outcomes)
    reported = sum(each.reported is not Reason.NONE for each in by_time_outs if each.injected in PLACED)
    right = sum(each.right for each in outcomes)
    summary = (
        f"Of {placed} injections into pump, air, valves and sensors **{_right_of_plant(outcomes):.1f} %** have the "
        f"right reason at the right place. By time-outs alone (`diagnose: false`), the simplest baseline, "
        f"{_right_of_plant(by_time_outs):.1f} % of them have, and {reported} are reported at all. Of all "
        f"{len(outcomes)} injections {right} have: **{100.0 * right / len(outcomes):.1f} %**. False alarms in "
        f"{hours:g} h of healthy jamming: **{len(false_alarms)}**."
    )
    head = "| injected | n | right | by time-outs | reported, where wrong | delay, median, s | longest, s | in time |"
    lines = [summary, "", head, "|---|---:|---:|---:|---|---:|---:|---:|"]
    for reason in REASONS:
        mine = [each for each in outcomes if each.injected is reason]
        if not mine:
            continue
        plain = sum(each.right for each in by_time_outs if each.injected is reason)
        good = [each for each in mine if each.right]
        delays = [each.delay_s for each in good]
        typical = f"{statistics.median(delays):.2f}" if delays else "-"
        longest = f"{max(delays):.2f}" if delays else "-"
        in_time = sum(each.delay_s <= WITHIN_S[reason] for each in good)
        cells = (len(mine), len(good), plain, _wrong(mine), typical, longest, f"{in_time} in {WITHIN_S[reason]:g} s")
        lines.append(f"| {reason.name} | {' | '.join(map(str, cells))} |")
    return "\n".join(lines) + "\n"


def _right_of_plant(outcomes: Sequence[Outcome]) -> float:
    return 100.0 * statistics.fmean(each.right for each in outcomes if each.injected in PLACED)


def _wrong(outcomes: Iterable[Outcome]) -> str:
    counts: dict[str, int] = {}
    for each in outcomes:
        if not each.right:
            name = (
                each.reported.name if each.reported is not each.injected else f"{each.reported.name} at another place"
            )
            name = "nothing" if each.reported is Reason.NONE else name
            counts[name] = counts.get(name, 0) + 1
    return ", ".join(f"{count} {name}" for name, count in sorted(counts.items())) or ""
