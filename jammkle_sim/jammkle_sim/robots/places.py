"""Where the legs of our simulated robots are on their bodies, as a controller wants to know it."""

from __future__ import annotations

from jammkle_sim.robots.quadruped import CORNERS, QuadrupedParameters


def place_of(ankle: str) -> dict[str, float]:
    """Return parameters of the controller of an ankle, by its name; of a leg's none: its hip is its base's origin."""
    quadruped = QuadrupedParameters()
    return {
        name: value
        for corner in CORNERS
        if corner.ankle == ankle
        for name, value in (
            ("hip_x_m", corner.forward * quadruped.forward_m),
            ("hip_y_m", corner.left * quadruped.left_m),
            ("hip_offset_m", corner.left * quadruped.offset_m),
        )
    }
