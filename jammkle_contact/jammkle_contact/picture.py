"""The picture of `jammkle detect`: what the IMU read, what was felt, and what was decided."""

from __future__ import annotations

from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from jammkle_controller.core.events import ContactKind
from jammkle_graph.command.figures import EVENT_COLOURS, LINE_COLOURS, STYLE
from jammkle_graph.constants import NANOSECONDS_PER_SECOND

if TYPE_CHECKING:
    from pathlib import Path

    from jammkle_contact.recording import Recording
    from jammkle_contact.replay import Replay

_KPA = 1e3


def draw(recording: Recording, replay: Replay, path: Path) -> None:
    """Write the picture.

    Raises:
        OSError: it cannot be written.

    """
    samples = recording.samples()
    rows = np.array(samples, dtype=float)
    time_s = np.array([sample.time_ns - samples[0].time_ns for sample in samples]) / NANOSECONDS_PER_SECOND
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(11.0, 8.0), layout="constrained")
        force, rate, swing, wish = figure.subplots(4, 1, sharex=True, height_ratios=(3, 2, 1.5, 1.5))
        force.plot(time_s, np.linalg.norm(rows[:, 1:4], axis=1), color="#444444", linewidth=0.7)
        force.set_ylabel("|specific force|\n[m/s²]")
        rate.plot(time_s, np.linalg.norm(rows[:, 4:7], axis=1), color="#444444", linewidth=0.7)
        rate.set_ylabel("|angular velocity|\n[rad/s]")
        for kind in ContactKind:
            colour = EVENT_COLOURS[kind.name]
            times = [_seconds(event.time_ns, samples[0].time_ns) for event in replay.events if event.kind is kind]
            for axes in (force, rate):
                for index, at_s in enumerate(times):
                    axes.axvline(at_s, color=colour, linewidth=0.9, label=None if index else kind.value)
        if force.get_legend_handles_labels()[0]:
            force.legend(loc="upper right", ncols=5)
        swing.plot(
            [_seconds(at_ns, samples[0].time_ns) for at_ns, _ in replay.swing],
            [value for _, value in replay.swing],
            color="#1f5fa8",
        )
        swing.set_ylabel("P(off the ground)")
        swing.set_ylim(-0.05, 1.05)
        if recording.reference:
            beside = swing.twinx()
            beside.plot(
                [_seconds(at_ns, samples[0].time_ns) for at_ns, _ in recording.reference],
                [value for _, value in recording.reference],
                color="#888888",
                linewidth=0.7,
            )
            beside.set_ylabel("reference")
        changes = [*replay.decisions]
        for channel in changes[0].wish_pa if changes else ():
            times = [_seconds(each.time_ns, samples[0].time_ns) for each in changes] + [float(time_s[-1])]
            values = [each.wish_pa[channel] / _KPA for each in changes]
            wish.step(times, [*values, values[-1]], where="post", label=channel, color=LINE_COLOURS.get(channel))
        wish.set_ylabel("wanted vacuum\n[kPa]")
        wish.set_xlabel("time [s]")
        if changes:
            wish.legend(loc="upper right", ncols=3)
        for at_ns, reason in replay.troubles:
            if reason:
                wish.axvline(_seconds(at_ns, samples[0].time_ns), color="#c1121f", linestyle=":", linewidth=0.8)
        figure.suptitle(f"{recording.name}: {len(replay.events)} events")
        figure.savefig(path, dpi=130)


def _seconds(time_ns: int, begin_ns: int) -> float:
    return (time_ns - begin_ns) / NANOSECONDS_PER_SECOND
