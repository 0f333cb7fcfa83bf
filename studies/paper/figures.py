"""Every figure of the page: as SVG text, without a date, so that the same runs give the same bytes."""

from __future__ import annotations

import io
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from jammkle_common.command.results import STYLE
from jammkle_sim.physics.constants import TENDON_SETS
from jammkle_sim.physics.sensors import CLIP_NET_M_S2
from studies.paper.reference import (
    EXTENSION_M,
    REFERENCE_OPTIONS,
    contact_pressure_pa,
    cycle_m,
    fibres_at_rate,
    reference_tension_n,
)
from studies.paper.runs import ENERGY, MATERIALS, PARAMETER_SETS, SLIP_EXPERIMENTS, VACUUMS_KPA, curve_identifier
from studies.paper.shear_lag import ShearLagTendon
from studies.paper.tables import DROP_ROWS, ROWS, paper_row

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from jammkle_sim.physics.constants import TendonParameters
    from studies.paper.comparison import Outcomes, RowComparison
    from studies.paper.runs import Curve

_STEPS = 20


@dataclass(frozen=True)
class Deformation:
    """Strain of a tendon at 20 mm."""

    vacuum_pa: float
    place_mm: NDArray[np.float64]
    """Middle of each element from the lower end plate, undeformed, shape (n,)."""
    strain: NDArray[np.float64]
    """Mean strain of all fibres in each element, shape (n,)."""
    soft_strain: NDArray[np.float64]
    """Mean strain of the fibres that are soft there, shape (n,); NaN where none is."""
    stiff_strain: NDArray[np.float64]
    """As above, of the stiff ones."""
    soft_share: float
    """Share of the extension that the soft sections take, mean over the fibres."""


def deformation(parameters: TendonParameters, vacuum_pa: float) -> Deformation:
    """Stretch a fresh reference tendon to 20 mm at constant vacuum and look where its strain is."""
    tendon = ShearLagTendon(fibres_at_rate(parameters), REFERENCE_OPTIONS)
    pulled_m = np.linspace(0.0, EXTENSION_M, _STEPS + 1)
    tendon.follow(pulled_m, np.full(len(pulled_m), contact_pressure_pa(parameters, vacuum_pa)))
    strain, soft, length_m = tendon.strain, tendon.soft, tendon.element_m
    end_m = np.cumsum(length_m)
    stretch_m = strain * length_m[:, None]
    return Deformation(
        vacuum_pa,
        (end_m - length_m / 2.0) * 1e3,
        strain.mean(axis=1),
        _mean_where(strain, soft),
        _mean_where(strain, ~soft),
        float(stretch_m[soft].sum() / stretch_m.sum()),
    )


def _mean_where(strain: NDArray[np.float64], chosen: NDArray[np.bool_]) -> NDArray[np.float64]:
    count = chosen.sum(axis=1)
    total = np.where(chosen, strain, 0.0).sum(axis=1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


SET_NAMES = {"fitted": "fitted", "as_printed": "as printed"}
"""Parameter sets for people."""

WIDTH_IN = 9.0
SET_COLOURS = {"fitted": "#1f5fa8", "as_printed": "#d9741a"}
VACUUM_COLOURS = {0: "#9ec5e8", 10: "#5b9bd5", 30: "#1f5fa8", 50: "#0b2545"}
EXTENSION = "extension [mm]"
FORCE = "force [N]"
_PAPER: dict[str, Any] = {"color": "black", "marker": "o", "markersize": 4, "capsize": 4, "linestyle": "none"}
_FULL_MM = 20.0


@dataclass(frozen=True)
class Picture:
    """One figure of the page."""

    identifier: str
    title: str
    paper: str
    """Which figure of the paper it stands beside; empty for none."""
    caption: str
    svg: str


def finished(identifier: str, figure: Figure, title: str, paper: str, caption: str) -> Picture:
    """Return a figure as SVG text, without a date, so that the same runs give the same bytes."""
    file = io.StringIO()
    figure.savefig(file, format="svg", metadata={"Date": None, "Creator": None})
    return Picture(identifier, title, paper, caption, file.getvalue())


def draw(axes: Axes, curves: Sequence[Curve], colour: str, label: str, style: str = "-") -> None:
    """Draw the repeats of one experiment in one colour, with one entry in the legend."""
    for i, curve in enumerate(curves):
        axes.plot(curve.x, curve.y, style, color=colour, alpha=0.85, linewidth=0.9, label=None if i else label)


def paper_mean(axes: Axes, identifier: str, label: str | None) -> None:
    """Mark the paper's mean peak and its standard error at 20 mm."""
    row = paper_row(identifier)
    axes.errorbar(_FULL_MM, row.mean, yerr=row.standard_error, zorder=5, label=label, **_PAPER)


def label_axes(axes: Axes, x: str, y: str) -> None:
    """Name both axes."""
    axes.set_xlabel(x)
    axes.set_ylabel(y)


def pressures(outcomes: Outcomes) -> Picture:
    """Draw load and return of the multi-material tendon at four pressures."""
    figure = Figure(figsize=(WIDTH_IN, 4.2), layout="constrained")
    axes = figure.subplots()
    for kpa in VACUUMS_KPA:
        curves = outcomes.curves(curve_identifier("multi", kpa), "fitted")
        draw(axes, curves, VACUUM_COLOURS[kpa], f"{-kpa} kPa")
        paper_mean(axes, curve_identifier("multi", kpa), "paper, mean peak and standard error" if kpa == 0 else None)
    label_axes(axes, EXTENSION, FORCE)
    axes.legend(loc="upper left")
    return finished(
        "JammingPressurePlots", figure, "Force over displacement at four pressures", "Figure 4 (JammingPressurePlots)",
        "Multi-material tendon, set `fitted`, 5 mm/s to 20 mm and back; the lower branch of each loop is the return. "
        "Every repeat is drawn. The paper's figure shows five repeats of each as well.",
    )  # fmt: skip


def materials(outcomes: Outcomes) -> Picture:
    """Draw load and return of every material with both parameter sets."""
    figure = Figure(figsize=(WIDTH_IN, 5.6), layout="constrained")
    grid = figure.subplots(2, 3, sharex=True, sharey="col")
    for i, parameter_set in enumerate(PARAMETER_SETS):
        for j, (material, name) in enumerate(MATERIALS.items()):
            axes = grid[i, j]
            for kpa in VACUUMS_KPA:
                identifier = curve_identifier(material, kpa)
                style = "-" if parameter_set == "fitted" or material == "multi" or not kpa else "--"
                draw(axes, outcomes.curves(identifier, parameter_set), VACUUM_COLOURS[kpa], f"{-kpa} kPa", style)
                if any(row.identifier == identifier for row in ROWS):
                    paper_mean(axes, identifier, "paper" if kpa == 0 else None)
            axes.set_title(f"{name}, {SET_NAMES[parameter_set]}")
            label_axes(axes, EXTENSION if i else "", "" if j else FORCE)
    grid[0, 0].legend(loc="upper left")
    return finished(
        "materials", figure, "Force over displacement of the three materials", "Table II, rows 1 to 9",
        "Load and return at 0, -10, -30 and -50 kPa. As printed, the single-material tendons do not feel the vacuum at "
        "all: their fibres are alike and do not slide on each other, and the paper's model has no other effect of "
        "pressure, so that the four curves lie on each other.",
    )  # fmt: skip


def models(outcomes: Outcomes) -> Picture:
    """Draw the rig with both parameter sets and the reference model, elongation only."""
    figure = Figure(figsize=(WIDTH_IN, 3.6), layout="constrained")
    panels = figure.subplots(1, 2)
    path_m = cycle_m()
    up_m = path_m[: len(path_m) // 2 + 1]
    for axes, letter, kpa in zip(panels, "ab", (0, 50), strict=True):
        identifier = curve_identifier("multi", kpa)
        for parameter_set in PARAMETER_SETS:
            curves = [_loading(curve) for curve in outcomes.curves(identifier, parameter_set)]
            draw(axes, curves, SET_COLOURS[parameter_set], f"rig, {SET_NAMES[parameter_set]}")
        reference_n = reference_tension_n(TENDON_SETS["fitted"], kpa * 1e3, up_m)
        axes.plot(up_m * 1e3, reference_n, ":", color="#2e7d32", linewidth=1.8, label="reference model, 18 fibres")
        paper_mean(axes, identifier, "paper, mean peak")
        axes.set_title(f"({letter}) {'jammed, -50 kPa' if kpa else 'unjammed'}")
        label_axes(axes, EXTENSION, FORCE)
        axes.set_ylim(bottom=0.0)
        axes.legend(loc="upper left")
    return finished(
        "SimulatedJamming", figure, "Models of the tendon beside the measured peak", "Figure 5 (SimulatedJamming)",
        "Elongation only, as in the paper. The reference model has 18 fibres along the length and the constants of "
        "`fitted` at the rate of the test. It has neither relaxation nor membrane, and so lies lower when jammed.",
    )  # fmt: skip


def strain(deformations: Sequence[Deformation]) -> Picture:
    """Draw strain along the tendon and the share of either section."""
    figure = Figure(figsize=(WIDTH_IN, 3.6), layout="constrained")
    *panels, bars = figure.subplots(1, 3, width_ratios=(3, 3, 2))
    largest = max(float(np.nanmax(each.soft_strain)) for each in deformations)
    for axes, letter, each in zip(panels, "ab", deformations, strict=True):
        axes.plot(each.place_mm, each.soft_strain * 100.0, ".-", color="#c0392b", markersize=4, label="soft fibres")
        axes.plot(each.place_mm, each.stiff_strain * 100.0, ".-", color="#1f5fa8", markersize=4, label="stiff fibres")
        axes.plot(each.place_mm, each.strain * 100.0, color="black", label="mean of all")
        axes.set_ylim(0.0, largest * 135.0)
        axes.set_title(f"({letter}) {_state(each)}")
        label_axes(axes, "place along the fibres [mm]", "strain [%]" if letter == "a" else "")
        axes.legend(loc="upper center", ncols=2)
    soft = [each.soft_share * 100.0 for each in deformations]
    stiff = [100.0 - share for share in soft]
    names = [_state(each).replace(", ", "\n") for each in deformations]
    bars.bar(names, soft, color="#c0392b", alpha=0.8, label="soft")
    bars.bar(names, stiff, bottom=soft, color="#1f5fa8", alpha=0.8, label="stiff")
    for i, share in enumerate(soft):
        bars.text(i, share / 2.0, f"{share:.0f} %", ha="center", va="center", color="white")
        bars.text(i, 50.0 + share / 2.0, f"{100.0 - share:.0f} %", ha="center", va="center", color="white")
    bars.set_title("share of the extension")
    bars.grid(visible=False)
    bars.set_ylabel("%")
    return finished(
        "ComsolFig", figure, "Where the stretch sits along the tendon at 20 mm", "Figure 6 (ComsolFig)",
        "Reference model, set `fitted`. Soft fibres lie at both ends, as every second one is mirrored; in the middle "
        "all are stiff. Unjammed the soft sections take most of the stretch; jammed, friction makes the stiff ones "
        "beside them stretch as well.",
    )  # fmt: skip


def _loading(curve: Curve) -> Curve:
    end = int(curve.x.argmax()) + 1
    return type(curve)(curve.x[:end], curve.y[:end])


def _state(each: Deformation) -> str:
    return f"jammed, {-each.vacuum_pa / 1e3:.0f} kPa" if each.vacuum_pa else "unjammed"


def drops(outcomes: Outcomes) -> Picture:
    """Draw the acceleration of every foot over time."""
    figure = Figure(figsize=(WIDTH_IN, 5.4), layout="constrained")
    grid = figure.subplots(2, 3, sharex=True, sharey=True)
    for i, (axes, row) in enumerate(zip(grid.flat, DROP_ROWS, strict=False)):
        axes.axhline(CLIP_NET_M_S2, color="#888888", linestyle=":", linewidth=1.0)
        axes.axhline(row.mean, color="black", linestyle="--", linewidth=0.9, label="paper, mean peak")
        draw(axes, outcomes.curves(row.identifier, "fitted"), SET_COLOURS["fitted"], "simulation, fitted")
        axes.set_title(f"({'abcde'[i]}) {row.title}")
        label_axes(
            axes,
            "time from touch-down [s]" if i > 1 else "",
            "upward acceleration\nless gravity [m/s²]" if i % 3 == 0 else "",
        )
    grid[0, 2].tick_params(labelbottom=True)
    grid[0, 2].set_xlabel("time from touch-down [s]")
    handles, labels = grid[0, 0].get_legend_handles_labels()
    grid[1, 2].axis("off")
    grid[1, 2].legend(
        [*handles, Line2D([], [], color="#888888", linestyle=":")],
        [*labels, "limit of the sensor"],
        loc="center",
    )
    return finished(
        "fig9", figure, "Acceleration in the drop test, five feet", "Figure 9 (fig9)",
        "IMU on the platform, every repeat, 1.8 kg from 50 mm. In free fall it reads -9.81 m/s². The rigid ankle and "
        "the standard foot reach the limit of the sensor.",
    )  # fmt: skip


def slips(outcomes: Outcomes) -> Picture:
    """Draw force over descent of every foot, and the energy that each dissipates."""
    figure = Figure(figsize=(WIDTH_IN, 5.8), layout="constrained")
    grid = figure.subplots(2, 2)
    *panels, bars = grid.flat
    for axes, letter, experiment in zip(panels, "abc", SLIP_EXPERIMENTS, strict=True):
        for parameter_set in PARAMETER_SETS:
            curves = outcomes.curves(experiment.identifier, parameter_set)
            draw(axes, curves, SET_COLOURS[parameter_set], SET_NAMES[parameter_set])
        axes.set_title(f"({letter}) {experiment.title}")
        label_axes(axes, "descent [mm]", "push on the slope [N]")
        axes.legend(loc="upper right")
    top = max(axes.get_ylim()[1] for axes in panels)
    for axes in panels:
        axes.set_ylim(0.0, top)
    width = 0.38
    places = np.arange(len(SLIP_EXPERIMENTS))
    for shift, parameter_set in zip((-width / 2.0, width / 2.0), PARAMETER_SETS, strict=True):
        energy = [outcomes.statistic(each.identifier, parameter_set, ENERGY) for each in SLIP_EXPERIMENTS]
        drawn = bars.bar(
            places + shift,
            [each.mean for each in energy],
            width,
            yerr=[each.standard_error for each in energy],
            color=SET_COLOURS[parameter_set],
            label=SET_NAMES[parameter_set],
            capsize=3,
        )
        bars.bar_label(drawn, fmt="%.2f", fontsize=8, padding=2)
    bars.set_xticks(places, [each.title for each in SLIP_EXPERIMENTS])
    bars.grid(visible=False, axis="x")
    bars.set_title("(d) Dissipated energy")
    bars.set_ylabel("work of the push [J]")
    bars.legend()
    return finished(
        "fig8", figure, "Slip test: force over descent, and what is dissipated", "Figure 10 (fig8)",
        "40 degree slope, 5 mm/s down for 110 mm, every repeat. The paper prints no numbers here. The two ankles' "
        "force jumps when the heel lands. The rigid ankle has no tendons, so that both sets give the same.",
    )  # fmt: skip


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
