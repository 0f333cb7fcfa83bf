"""Counterparts of the paper's figures of one tendon."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from jammkle_sim.fit.reference import cycle_m, reference_tension_n
from jammkle_sim.paper.drawing import (
    EXTENSION,
    FORCE,
    SET_COLOURS,
    SET_NAMES,
    VACUUM_COLOURS,
    WIDTH_IN,
    Picture,
    draw,
    finished,
    label_axes,
    paper_mean,
)
from jammkle_sim.paper.experiments import MATERIALS, PARAMETER_SETS, VACUUMS_KPA, curve_identifier
from jammkle_sim.paper_tables import ROWS
from jammkle_sim.physics.constants import TENDON_SETS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jammkle_sim.paper.comparison import Outcomes
    from jammkle_sim.paper.deformation import Deformation
    from jammkle_sim.paper.runs import Curve


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
