"""Vectors as tuples of three, and turns as matrices, for compiled loops."""

from __future__ import annotations

import math
from typing import Any

from studies.blind.reality.compiled import compiled

Vector = tuple[float, float, float]

STILL = 1e-12
"""Turns, speeds and forces below it are none, in SI."""


@compiled
def vector(values: Any, at: int) -> Vector:
    """Return three numbers of an array, from an index on."""
    return (values[at], values[at + 1], values[at + 2])


@compiled
def row(values: Any, at: int) -> Vector:
    """Return a row of an array of shape (n, 3)."""
    return (values[at, 0], values[at, 1], values[at, 2])


@compiled
def turned(matrix: Any, arm: Vector) -> Vector:
    """Return a vector of a body's frame in the world's, by the body's turn of shape (3, 3)."""
    return (
        matrix[0, 0] * arm[0] + matrix[0, 1] * arm[1] + matrix[0, 2] * arm[2],
        matrix[1, 0] * arm[0] + matrix[1, 1] * arm[1] + matrix[1, 2] * arm[2],
        matrix[2, 0] * arm[0] + matrix[2, 1] * arm[1] + matrix[2, 2] * arm[2],
    )


@compiled
def cross(a: Vector, b: Vector) -> Vector:
    """Return a cross b."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@compiled
def dot(a: Vector, b: Vector) -> float:
    """Return a times b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled
def plus(a: Vector, b: Vector) -> Vector:
    """Return a plus b."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


@compiled
def less(a: Vector, b: Vector) -> Vector:
    """Return a less b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


@compiled
def scaled(a: Vector, factor: float) -> Vector:
    """Return a vector made longer by a factor."""
    return (a[0] * factor, a[1] * factor, a[2] * factor)


@compiled
def turn(matrix: Any, spin: Vector, step_s: float) -> None:
    """Turn a body on by Rodrigues' formula, in place."""
    fast = math.sqrt(dot(spin, spin))
    angle = fast * step_s
    if angle < STILL:
        return
    axis = scaled(spin, 1.0 / fast)
    sine, less = math.sin(angle), 1.0 - math.cos(angle)
    for j in range(3):
        column = (matrix[0, j], matrix[1, j], matrix[2, j])
        first = cross(axis, column)
        second = cross(axis, first)
        for i in range(3):
            matrix[i, j] = column[i] + sine * first[i] + less * second[i]
