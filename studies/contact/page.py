"""The page of a trial: figures with intervals beside their aims and the simpler ways, and the delays as a picture."""

from __future__ import annotations

import io
from importlib import resources
from typing import TYPE_CHECKING, Any

import jinja2
import matplotlib as mpl
import numpy as np
from markupsafe import Markup
from matplotlib.figure import Figure

from jammkle_common.command.results import STYLE
from jammkle_controller.parameters import Mount
from studies.contact.trial import (
    HELD_OUT,
    KINDS,
    OURS,
    SOURCES,
    TUNING,
    WINDOWS_S,
    WITH_ANKLE,
    WITH_EFFORTS,
    WITH_ODOMETRY,
    Outcome,
    best_settings,
    finite,
    median_with_interval,
    pooled,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

AIMS = {
    "impact": "recall and precision 0.995, median delay under 3 ms",
    "slip": "recall and precision 0.95, before 10 mm in the median",
    "lift-off": "recall and precision 0.98",
}
MS, MM = 1e3, 1e3


def results(outcome: Outcome, benefit: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return all figures for machines, and for the page."""
    rows = []
    for part, sources in SOURCES.items():
        more = [
            way
            for way in (WITH_ANKLE, WITH_EFFORTS, WITH_ODOMETRY)
            if any(key[0] == part and key[4] == way for key in outcome.scores)
        ]
        places = [("", ""), *(("", mount.value) for mount in Mount), *sources]
        for kind in KINDS:
            for source, mount in places:
                best = best_settings(outcome, mount)
                ways = (
                    OURS,
                    *(way for way in more if kind == "slip" or way != WITH_ODOMETRY),
                    *(best[kind, name] for each, name in best if each == kind),
                )
                for way in ways:
                    score = pooled(outcome, part, kind, way, mount, source)
                    row: dict[str, Any] = {
                        "part": part,
                        "source": source or "all",
                        "mount": mount or "all",
                        "kind": kind,
                        "way": way,
                    }
                    row |= score.figures()
                    row["delay_ms"] = finite([MS * value for value in median_with_interval(score.delays_s)])
                    row["slid_mm"] = finite([MM * value for value in median_with_interval(score.ways_m)])
                    rows.append(row)
    return {
        "steps": dict(outcome.steps),
        "unavailable": outcome.unavailable,
        "blown_up": outcome.empty,
        "aims": AIMS,
        "windows_s": {kind: list(window) for kind, window in WINDOWS_S.items()},
        "rows": rows,
        "benefit": list(benefit),
    }


def page(outcome: Outcome, figures: dict[str, Any], seed: int) -> str:
    """Return the page as HTML that needs no network."""
    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True)
    environment.filters["interval"] = _interval
    source = resources.files(__package__).joinpath("page.html.j2").read_text(encoding="utf-8")
    return environment.from_string(source).render(
        figures=figures,
        seed=seed,
        parts=(HELD_OUT, TUNING),
        kinds=tuple(KINDS),
        delays=Markup(_delays(outcome)),  # noqa: S704 - made here, of numbers
    )


def _interval(values: Sequence[float] | None, digits: int = 3) -> str:
    if values is None:
        return "-"
    value, low, high = values
    return f"{value:.{digits}f} ({low:.{digits}f} to {high:.{digits}f})"


def _delays(outcome: Outcome) -> str:
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.0, 3.0), layout="constrained")
        for axes, kind in zip(figure.subplots(1, len(KINDS)), KINDS, strict=True):
            for part, style in ((HELD_OUT, "-"), (TUNING, "--")):
                delays = np.sort(pooled(outcome, part, kind, OURS).delays_s) * MS
                if len(delays):
                    axes.step(delays, np.arange(1, len(delays) + 1) / len(delays), style, label=part)
            axes.set_title(kind)
            axes.set_xlabel("delay [ms]")
            if axes.get_legend_handles_labels()[0]:
                axes.legend(loc="lower right")
        file = io.StringIO()
        figure.savefig(file, format="svg", metadata={"Date": None, "Creator": None})
        return file.getvalue()
