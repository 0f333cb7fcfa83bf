"""All figures of the page: all rows at a glance, then the counterparts of the paper's figures that hold data."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import matplotlib as mpl
from matplotlib.figure import Figure

from jammkle_graph.command.figures import STYLE
from jammkle_sim.paper.ankle_figures import drops, slips
from jammkle_sim.paper.drawing import SET_COLOURS, SET_NAMES, WIDTH_IN, Picture, finished
from jammkle_sim.paper.experiments import PARAMETER_SETS
from jammkle_sim.paper.tendon_figures import materials, models, pressures, strain
from jammkle_sim.paper_tables import ROWS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jammkle_sim.paper.comparison import Outcomes, RowComparison
    from jammkle_sim.paper.deformation import Deformation

_LINEAR_Z = 2.0
_WIDEST_Z = 700.0
_MARKS: dict[str, dict[str, Any]] = {
    "fitted": {"marker": "o", "markersize": 5},
    "as_printed": {"marker": "s", "markersize": 8, "markerfacecolor": "white"},
}


def pictures(
    outcomes: Outcomes, rows: Sequence[RowComparison], deformations: Sequence[Deformation]
) -> tuple[Picture, ...]:
    """Draw everything.

    Args:
        outcomes: Finished runs.
        rows: Every row of the tables, compared.
        deformations: Unjammed and jammed.

    """
    with mpl.rc_context(STYLE):
        return (
            _glance(rows),
            pressures(outcomes),
            materials(outcomes),
            models(outcomes),
            strain(deformations),
            drops(outcomes),
            slips(outcomes),
        )


def _glance(rows: Sequence[RowComparison]) -> Picture:
    figure = Figure(figsize=(WIDTH_IN, 4.2), layout="constrained")
    axes = figure.subplots()
    places = {row.identifier: -float(i) for i, row in enumerate(ROWS)}
    axes.axvspan(-_LINEAR_Z, _LINEAR_Z, color="#2e7d32", alpha=0.12, linewidth=0, label="within 2 standard errors")
    for parameter_set in reversed(PARAMETER_SETS):  # where both are equal the smaller mark is on top
        mine = [row for row in rows if row.parameter_set == parameter_set]
        axes.plot(
            [row.z for row in mine],
            [places[row.row.identifier] for row in mine],
            color=SET_COLOURS[parameter_set],
            label=SET_NAMES[parameter_set],
            linestyle="none",
            **_MARKS[parameter_set],
        )
    axes.axvline(0.0, color="black", linewidth=0.8)
    axes.set_xscale("symlog", linthresh=_LINEAR_Z)
    axes.set_xlim(-_WIDEST_Z, _WIDEST_Z)
    ticks = [-100, -10, -2, 0, 2, 10, 100]
    axes.set_xticks(ticks, [f"{tick:+d}" if tick else "0" for tick in ticks])
    axes.set_xlabel("simulation minus paper, in standard errors of the paper (linear to 2, logarithmic beyond)")
    axes.set_yticks(list(places.values()), [row.title for row in ROWS])
    axes.legend(loc="upper center", bbox_to_anchor=(0.4, 1.1), ncols=3)
    return finished(
        "glance", figure, "All rows of both tables", "",
        "Each mark is the mean of the repeats. The two uppermost drop rows are clipped by the sensor, so that the "
        "paper's standard error there is 0.005 m/s²: six standard errors are 0.04 % of the value.",
    )  # fmt: skip
