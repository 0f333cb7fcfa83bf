"""What the diagnosis aims for, and what each figure is called."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class Aim:
    """One figure with what it should be."""

    figure: str
    text: str
    aim: str
    low: float = float("-inf")
    high: float = float("inf")
    is_share: bool = True

    def is_met(self, value: float) -> bool:
        """Tell whether a value is as it should be."""
        return self.low <= value <= self.high


AIMS: Final = (
    Aim("false_alarms", "false alarms of healthy machines", "at most 1 %", high=0.01),
    Aim("top_1_from_4", "right name first, four times what an ideal one needs and above", "at least 95 %", low=0.95),
    Aim("top_1_at_2", "right name first, twice what an ideal one needs", "at least 80 %", low=0.8),
    Aim("pairs_exact", "pairs named exactly", "at least 60 %", low=0.6),
    Aim("pairs_in_set", "pairs named, or in the set", "at least 85 %", low=0.85),
    Aim("unknown_rejected", "outside the library and visible: said to be unknown", "at least 85 %", low=0.85),
    Aim("wrong_among_named", "wrong names among those named for certain", "at most 3 %", high=0.03),
    Aim("probability_on_truth", "mean probability on the truth", "at least 0.85", low=0.85, is_share=False),
    Aim("calibration_error", "calibration error of the posterior", "below 0.05", high=0.05, is_share=False),
    Aim("coverage", "sets that hold the truth", "at least 95 %", low=0.95),
    Aim("set_size", "mean size of a set", "below 1.6", high=1.6, is_share=False),
    Aim("closed_of_ceiling", "gap closed, of what the ceiling closes", "at least 0.9", low=0.9, is_share=False),
    Aim("intervals_90", "90 % intervals that hold the truth", "85 to 95 %", low=0.85, high=0.95),
    Aim("left_out_unnamed", "each effect left out once: nothing named for certain", "at least 95 %", low=0.95),
)
"""In the order of the page."""

OTHERS: Final = (
    Aim("top_1", "right name first, all that an ideal detector sees", ""),
    Aim("top_2", "right name among two, all that an ideal detector sees", ""),
    Aim("top_1_at_0", "right name first, less than an ideal detector needs", ""),
    Aim("top_1_at_1", "right name first, just what an ideal detector needs", ""),
    Aim("top_1_from_2", "right name first, twice and above", ""),
    Aim("top_2_from_2", "right name among two, twice and above", ""),
    Aim("top_2_at_2", "right name among two, twice", ""),
    Aim("top_2_from_4", "right name among two, four times and above", ""),
    Aim("ranked_at_2", "right name most probable whether or not a gap was seen, twice", ""),
    Aim("ranked_from_4", "right name most probable whether or not a gap was seen, four times and above", ""),
    Aim("detected_at_0", "seen, less than an ideal detector needs", ""),
    Aim("detected_at_1", "seen, just what an ideal detector needs", ""),
    Aim("detected_at_2", "seen, twice", ""),
    Aim("detected_at_4", "seen, four times", ""),
    Aim("detected_at_8", "seen, eight times", ""),
    Aim("pairs_first", "pairs first in the set", ""),
    Aim("wrong_names", "wrong names among all cases", ""),
    Aim("wrong_sets", "sets without the truth, among all cases", ""),
    Aim("sets_exact", "sets that are complete without a false member (DXC 2026)", ""),
    Aim("unknown_unnamed", "outside the library and visible: nothing named for certain", ""),
    Aim("unknown_below_1", "outside the library, less than an ideal detector needs: said to be unknown", ""),
    Aim("left_out_unknown", "each effect left out once: said to be unknown", ""),
    Aim("midrun_safe", "change in mid-run: no wrong name, no wrong set", ""),
    Aim("located", "right subsystem, twice and above, of those seen", ""),
    Aim("probability_on_truth_from_2", "mean probability on the truth, healthy or twice and above", "", is_share=False),
    Aim(
        "probability_on_truth_of_faults_from_2",
        "mean probability on the truth, faults of twice and above",
        "",
        is_share=False,
    ),
    Aim("conformal_coverage", "true causes with a conformal p-value above 0.05 (95 % if right)", ""),
    Aim("conformal_size", "mean size of the conformal set", "", is_share=False),
    Aim("conformal_error", "calibration error of the conformal p-values", "", is_share=False),
    Aim("closed_of_oracle", "gap closed, of what the true effect closes", "", is_share=False),
    Aim("parameter_error", "error of a parameter, of its true size (median)", "", is_share=False),
    Aim("refused", "refused", ""),
    Aim("wall_s", "wall time of a diagnosis, s (median)", "", is_share=False),
    Aim("cpu_s", "processor time of a diagnosis, s (median)", "", is_share=False),
    Aim("simulator_runs", "simulator runs of a diagnosis (median)", "", is_share=False),
)
"""Without an aim of their own."""

BY_RIG: Final = ("false_alarms", "top_1_at_2", "top_1_from_4", "detected_at_2", "pairs_exact", "unknown_rejected",
                 "wrong_among_named", "coverage", "set_size")  # fmt: skip
"""Figures that are told rig by rig."""
