"""The picture of a landing: one fall of the leg in four ways, side by side, with their peaks."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from jammkle_sim.robots.options import RobotOptions
from studies.contact.benefit import Drop, deceleration_m_s2
from studies.contact.ways import AUTO, JAMMED, RATE_HZ, RIGID, SOFT

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

LANDING = RobotOptions(behaviour="drop", imu="body", drop_height_m=0.1, friction=0.8)
"""Falls by 100 mm onto level ground: soft, its heel strikes."""
TINTS = {SOFT: "#2f7ebc", JAMMED: "#c1512b", AUTO: "#2c8c4b", RIGID: "#555555"}
_BEFORE_S, _SHOWN_S = 0.02, 0.25
_DRAWN_S = (0.0, 0.03, 0.06, 0.1, 0.25)
"""Since the touch-down: when the leg is drawn, darker and darker."""
_MM_PER_M, _MS_PER_S = 1e3, 1e3


@dataclass(frozen=True)
class Landed:
    """What is drawn of one way."""

    time_s: NDArray[np.float64]
    """Since the touch-down, shape (n,)."""
    deceleration_m_s2: NDArray[np.float64]
    legs_m: list[NDArray[np.float64]]
    """Corners of the leg in its plane, each shape (7, 2): hip, knee, ankle, toe, heel, ankle again."""

    @property
    def peak_m_s2(self) -> float:
        """Largest deceleration."""
        return float(self.deceleration_m_s2.max())


def land(way: str) -> Landed:
    """Land in one way."""
    drop = Drop("leg", LANDING, way)
    up_m_s, stands, legs_m = [], [], []
    for sample in drop.samples():
        up_m_s.append(sample.base_velocity_m_s[2])
        stands.append(next(iter(sample.ankles.values())).foot.stands)
        legs_m.append(_leg_m(drop.simulation.data))
    slowed = deceleration_m_s2(np.array(up_m_s))
    touch = int(np.argmax(stands))
    drawn = [legs_m[touch + round(after_s * RATE_HZ)] for after_s in _DRAWN_S]
    time_s = (np.arange(len(slowed)) + 0.5 * (len(up_m_s) - len(slowed)) - touch) / RATE_HZ
    return Landed(time_s, slowed, drawn)


def _leg_m(data: Any) -> NDArray[np.float64]:
    """Return the corners of the leg in its plane, forward and up, m."""
    joints = [data.body(name).xpos for name in ("thigh", "shank", "ankle/foot")]
    sole = [data.geom(f"ankle/{end}_left").xpos for end in ("toe", "heel")]
    corners: NDArray[np.float64] = np.array([*joints, *sole, joints[-1]])[:, ::2]
    return corners


def draw(ways: dict[str, Landed]) -> Figure:
    """Draw legs above, decelerations below."""
    with mpl.rc_context({"font.size": 9, "axes.spines.top": False, "axes.spines.right": False}):
        figure = Figure(figsize=(9.6, 4.8), layout="constrained")
        legs, curves = figure.subplots(2, len(ways), height_ratios=(1.25, 1.0), sharex="row", sharey="row")
        for axes, below, (way, landed) in zip(legs, curves, ways.items(), strict=True):
            _draw_legs(axes, way, landed)
            _draw_curve(below, way, landed)
        legs[0].set_ylabel("height [mm]")
        curves[0].set_ylabel("deceleration [m/s²]")
    return figure


def _draw_legs(axes: Axes, way: str, landed: Landed) -> None:
    axes.set_title(f"{way}: {landed.peak_m_s2:.0f} m/s²", color=TINTS[way], fontweight="bold")
    ground_mm = _MM_PER_M * min(float(leg[3:5, 1].min()) for leg in landed.legs_m) - 5.0  # corners are rounded
    for place, leg_m in enumerate(landed.legs_m):
        strength = 0.12 + 0.88 * (place / (len(landed.legs_m) - 1)) ** 2
        x_mm, z_mm = _MM_PER_M * leg_m.T
        axes.plot(x_mm[:3], z_mm[:3] - ground_mm, color=TINTS[way], alpha=strength, linewidth=3.0, marker="o")
        axes.fill(x_mm[2:], z_mm[2:] - ground_mm, color=TINTS[way], alpha=strength)
    axes.axhline(0.0, color="black", linewidth=1.0)
    axes.set_aspect("equal")
    axes.set_xticks([])


def _draw_curve(axes: Axes, way: str, landed: Landed) -> None:
    shown = (landed.time_s >= -_BEFORE_S) & (landed.time_s <= _SHOWN_S)
    time_ms, slowed = _MS_PER_S * landed.time_s[shown], landed.deceleration_m_s2[shown]
    axes.plot(time_ms, slowed, color=TINTS[way])
    peak = int(slowed.argmax())
    axes.plot(time_ms[peak], slowed[peak], "o", color=TINTS[way])
    axes.set_xlabel("after touch-down [ms]")
    axes.grid(visible=True, alpha=0.3)


def main() -> int:
    """Draw the picture into the file that is named."""
    target = Path(sys.argv[1])
    draw({way: land(way) for way in TINTS}).savefig(target, dpi=110)
    return 0


if __name__ == "__main__":
    sys.exit(main())
