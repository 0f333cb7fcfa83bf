"""Counterparts of the paper's figures of the ankle: drop and slip."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from jammkle_sim.paper.drawing import SET_COLOURS, SET_NAMES, WIDTH_IN, Picture, draw, finished, label_axes
from jammkle_sim.paper.experiments import ENERGY, PARAMETER_SETS, SLIP_EXPERIMENTS
from jammkle_sim.paper_tables import DROP_ROWS
from jammkle_sim.physics.sensors import CLIP_NET_M_S2

if TYPE_CHECKING:
    from jammkle_sim.paper.comparison import Outcomes


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
