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
    Aim("false_alarms", "false alarms without a gap", "at most 1 %", high=0.01),
    Aim("wrong_names", "wrong names", "at most 2 %", high=0.02),
    Aim("unknown_rejected", "outside the library: said to be unknown", "at least 90 %", low=0.9),
    Aim("top_1_from_4", "right name first, four times the scatter and above", "at least 95 %", low=0.95),
    Aim("top_1_at_2", "right name first, twice the scatter", "at least 80 %", low=0.8),
    Aim("pairs_exact", "pairs named exactly", "at least 75 %", low=0.75),
    Aim("probability_on_truth", "mean probability on the truth", "at least 0.85", low=0.85, is_share=False),
    Aim("calibration_error", "calibration error", "below 0.05", high=0.05, is_share=False),
    Aim("coverage", "sets that hold the truth", "at least 95 %", low=0.95),
    Aim("set_size", "mean size of a set", "below 1.6", high=1.6, is_share=False),
    Aim("closed_of_oracle", "gap closed, of what the true effect closes", "at least 0.9", low=0.9, is_share=False),
    Aim("intervals_90", "90 % intervals that hold the truth", "85 to 95 %", low=0.85, high=0.95),
    Aim("located", "right subsystem, twice the scatter and above", "at least 95 %", low=0.95),
)
"""In the order of the page."""

OTHERS: Final = (
    Aim("wrong_sets", "sets without the truth", ""),
    Aim("top_1", "right name first, all sizes", ""),
    Aim("top_2", "right name among two, all sizes", ""),
    Aim("top_2_from_4", "right name among two, four times the scatter and above", ""),
    Aim("pairs_in_set", "pairs named, or in the set", ""),
    Aim("midrun_safe", "change in mid-run: no wrong name, no wrong set", ""),
    Aim("left_out_unknown", "each effect left out once: said to be unknown", ""),
    Aim("left_out_unnamed", "each effect left out once: nothing named for certain", ""),
    Aim(
        "probability_on_truth_from_2",
        "mean probability on the truth, no gap or twice the scatter and above",
        "",
        is_share=False,
    ),
    Aim("parameter_error", "error of a parameter, of its true size (median)", "", is_share=False),
    Aim("refused", "refused", ""),
    Aim("wall_s", "wall time of a diagnosis, s (median)", "", is_share=False),
    Aim("simulator_runs", "simulator runs of a diagnosis (median)", "", is_share=False),
)
"""Without an aim of their own."""
