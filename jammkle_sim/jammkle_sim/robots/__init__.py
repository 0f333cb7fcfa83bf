"""Robots that stand on jammable ankles: a leg, a quadruped, and any MJCF robot that an ankle is attached to."""
