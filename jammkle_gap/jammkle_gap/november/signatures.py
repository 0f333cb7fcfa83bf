"""Signatures: what the residual of a signal goes along with, each a number and a sentence."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from jammkle_gap.november.unexplained import rate_of

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.november.recording import Recording
    from jammkle_gap.november.residual import Layout, Piece

WORTH = 0.05
"""Signatures that go along with less of the squared residual than this are not listed."""
AT_FLOOR = 1.2
"""Signals whose gap is not above this have none; noise units."""
_HOLDING = "hold"


@dataclass(frozen=True)
class Signature:
    """One property of the residual of one signal."""

    signal: str
    kind: str
    value: float
    unit: str
    share: float
    """Of the squared residual that it goes along with, alone."""
    sentence: str


def _project(
    residual: NDArray[np.float64], shape: NDArray[np.float64], whole: NDArray[np.float64]
) -> tuple[float, float]:
    """Return the factor of a shape in a residual, and the share of the square of the whole that it takes."""
    power = float(shape @ shape)
    if power <= 0.0:
        return 0.0, 0.0
    factor = float(shape @ residual) / power
    return factor, factor**2 * power / max(float(whole @ whole), 1e-30)


def signatures(
    layout: Layout,
    recordings: Sequence[Recording],
    simulated: Sequence[Mapping[str, NDArray[np.float64]]],
    residual: NDArray[np.float64],
) -> tuple[Signature, ...]:
    """Look for every signature in every signal, and return those worth listing, strongest first."""
    gaps = layout.gaps(residual)
    found = [
        signature
        for name in layout.names
        if gaps[name] > AT_FLOOR
        for signature in _of_signal(layout, recordings, simulated, residual, name)
        if signature.share >= WORTH
    ]
    return tuple(sorted(found, key=lambda each: -each.share))


def _of_signal(
    layout: Layout,
    recordings: Sequence[Recording],
    simulated: Sequence[Mapping[str, NDArray[np.float64]]],
    residual: NDArray[np.float64],
    name: str,
) -> list[Signature]:
    pieces = [piece for piece in layout.pieces if piece.signal == name]
    unit = pieces[0].unit

    def joined(make: Mapping[int, NDArray[np.float64]]) -> NDArray[np.float64]:
        return np.concatenate([make[piece.recording] for piece in pieces])

    # In physical units, so that factors mean something.
    off = joined({piece.recording: (residual * layout.noise)[piece.where] for piece in pieces})
    level = joined({piece.recording: simulated[piece.recording][name] for piece in pieces})
    time = {piece.recording: layout.time_s[piece.where] for piece in pieces}
    rate = joined({p.recording: rate_of(simulated[p.recording][name], time[p.recording]) for p in pieces})
    since = joined({key: value - value[0] for key, value in time.items()})
    ones = np.ones_like(off)
    offset, offset_share = _project(off, ones, off)
    drift, drift_share = _project(off - offset, since - since.mean(), off)
    lag, lag_share = _project(off - offset, -rate, off)
    gain, gain_share = _project(off - offset, level - level.mean(), off)
    direction = np.sign(rate) * (np.abs(rate) > 1e-3 * np.abs(rate).max())
    sign, sign_share = _project(off - offset, direction, off)
    listed = [
        ("offset", offset, unit, offset_share, f"{name} lies {offset:+.3g} {unit} off throughout: a bias or a load"),
        ("drift", drift, f"{unit}/s", drift_share, f"{name} drifts by {drift:+.3g} {unit}/s: warming, creep or a leak"),
        ("lag", lag, "s", lag_share, f"{name} comes {1e3 * lag:+.3g} ms later than simulated: a delay or a compliance"),
        (
            "gain",
            gain,
            "1",
            gain_share,
            f"{name} is {100.0 * gain:+.3g} % larger than simulated: a gain or a stiffness",
        ),
        (
            "sign of rate",
            sign,
            unit,
            sign_share,
            f"{name} differs by {sign:+.3g} {unit} with the direction of motion: dry friction or backlash",
        ),
    ]
    found = [Signature(name, *each) for each in listed]
    found += _holds(layout, recordings, pieces, residual)
    found += _others(layout, recordings, pieces, off)
    return found


def _holds(
    layout: Layout, recordings: Sequence[Recording], pieces: Sequence[Piece], residual: NDArray[np.float64]
) -> list[Signature]:
    ramps, parts, whole = [], 0.0, max(sum(float(residual[p.where] @ residual[p.where]) for p in pieces), 1e-30)
    for piece in pieces:
        for phase in recordings[piece.recording].phases:
            if _HOLDING not in phase.name or (phase.signals and piece.signal not in phase.signals):
                continue
            time_s = layout.time_s[piece.where]
            inside = (time_s >= phase.start_s) & (time_s < phase.end_s)
            if inside.sum() > 4:  # noqa: PLR2004  # a line through fewer means nothing
                held = (residual * layout.noise)[piece.where][inside]
                since = time_s[inside] - time_s[inside].mean()
                factor, share = _project(held - held.mean(), since, held - held.mean())
                ramps.append(factor)
                parts += share * float((held - held.mean()) @ (held - held.mean()))
    if not ramps:
        return []
    ramp, name, unit = float(np.mean(ramps)), pieces[0].signal, pieces[0].unit
    sentence = f"{name} ramps by {ramp:+.3g} {unit}/s while it is held: a leak or creep"
    return [Signature(name, "ramp in holds", ramp, f"{unit}/s", parts / whole, sentence)]


def _others(
    layout: Layout, recordings: Sequence[Recording], pieces: Sequence[Piece], off: NDArray[np.float64]
) -> list[Signature]:
    found = []
    name, unit = pieces[0].signal, pieces[0].unit
    for other in layout.names:
        if other == name or any(other not in {s.name for s in recordings[p.recording].signals} for p in pieces):
            continue
        held = [recordings[p.recording].signal(other) for p in pieces]
        level = np.concatenate(
            [np.interp(layout.time_s[p.where], s.time_s, s.values) for p, s in zip(pieces, held, strict=True)]
        )
        factor, share = _project(off - off.mean(), level - level.mean(), off)
        sentence = f"{name} differs by {factor:+.3g} {unit} per {held[0].unit} of {other}"
        found.append(Signature(name, f"with {other}", factor, f"{unit} per {held[0].unit}", share, sentence))
    return found
