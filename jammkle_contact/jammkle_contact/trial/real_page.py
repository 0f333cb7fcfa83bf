"""What came of recordings of a real foot: figures for machines, and an overlay for a person to judge the truth by."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from jammkle_contact.trial.run import OURS
from jammkle_contact.trial.scoring import median_with_interval
from jammkle_graph.command.figures import STYLE

if TYPE_CHECKING:
    from pathlib import Path

    from jammkle_contact.trial.real_foot import RealFoot


def real_figures(foot: RealFoot) -> dict[str, Any]:
    """Return the figures of a recording."""
    rows = []
    for kind, way in foot.told_s:
        score = foot.score(kind, way)
        delay_s = median_with_interval(score.delays_s)[0]
        rows.append(
            {
                "kind": kind,
                "way": way,
                "true": score.hits + score.missed,
                "told": score.hits + score.false,
                "recall": [round(share, 4) for share in score.recall] if score.hits + score.missed else None,
                "precision": [round(share, 4) for share in score.precision] if score.hits + score.false else None,
                "delay_ms": round(1e3 * delay_s, 1) if score.delays_s else None,
            }
        )
    return {
        "name": foot.name,
        "clock": round(foot.fit.clock, 4),
        "shift_s": round(foot.fit.shift_s, 3),
        "correlation": round(foot.fit.correlation, 3),
        "rows": rows,
    }


def draw_real_foot(foot: RealFoot, path: Path) -> None:
    """Draw force and IMU over each other with what is true and what was told.

    Raises:
        OSError: it cannot be written.

    """
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(14.0, 7.0), layout="constrained")
        axes = figure.subplots(2, 1, sharex=True)
        for each, columns, name in (
            (axes[0], slice(0, 3), "|specific force| [m/s²]"),
            (axes[1], slice(3, 6), "|angular velocity| [rad/s]"),
        ):
            values = np.linalg.norm(foot.imu[:, columns], axis=1)
            each.plot(foot.imu_time_s, values, color="#c1121f", linewidth=0.7)
            each.plot(foot.force_time_s, foot.force / foot.force.max() * values.max(), color="#222222", linewidth=0.9)
            each.set_ylabel(f"{name}, force")
            for at_s in foot.touchdowns_s:
                each.axvline(at_s, color="#4f772d", linewidth=1.0)
            for kind, marker, colour in (("impact", "v", "#222222"), ("lift-off", "^", "#d9741a")):
                told_s = foot.told_s[kind, OURS]
                each.plot(told_s, np.full(len(told_s), -0.05 * values.max()), marker, color=colour, markersize=5)
        axes[1].set_xlabel("time of the force [s]")
        figure.suptitle(f"{foot.name}: touch-downs by the force (lines), told (down) and lift-offs told (up)")
        figure.savefig(path, dpi=110)
