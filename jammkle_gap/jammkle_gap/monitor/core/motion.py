"""What the slide does in a stretch of time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from jammkle_common import names

if TYPE_CHECKING:
    from jammkle_gap.monitor.core.followed import Stretch
    from jammkle_gap.monitor.core.tracks import Tracks

SLIDE = f"{names.CARRIAGE_JOINT}/position"
STILL_M_S = 0.002
"""Speed of the slide below which it counts as standing still. Assumed: as in the diagnosis of recordings."""
_IMPACT_M_S = 0.2
"""Change of speed within a stretch that makes it an impact. Assumed: a fall from 2 mm."""


def phase_of_motion(tracks: Tracks, stretch: Stretch) -> str:
    """Return `still`, `moving` or `impact`; `unknown` where the slide is not measured."""
    time_s, way_m = tracks.of(names.JOINT_STATES.name).within(SLIDE, stretch.begin_s, stretch.end_s)
    if len(time_s) < 3:  # noqa: PLR2004 - two speeds
        return "unknown"
    speed_m_s = np.diff(way_m) / np.diff(time_s)
    if np.max(np.abs(speed_m_s)) < STILL_M_S:
        return "still"
    fastest_down = int(np.argmin(speed_m_s))
    return "impact" if np.max(speed_m_s[fastest_down:]) - speed_m_s[fastest_down] > _IMPACT_M_S else "moving"
