"""The content of `corrected.yaml`: the effect that was found, and as comments the verdict and the calibration."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jammkle_gap.ankle.corrected import corrected_text
from jammkle_gap.core.result import Verdict
from jammkle_gap.report import words
from jammkle_gap.report.machine import constant_lines

if TYPE_CHECKING:
    from pathlib import Path

    from jammkle_gap.core.result import Diagnosis
    from jammkle_gap.core.simulate import Problem


def corrected_file(diagnosis: Diagnosis, problem: Problem, library_file: Path | None) -> str:
    """Return the effects file; without any effect where nothing is known to be the cause.

    Args:
        diagnosis: What was found.
        problem: Library that the effects are of, and constants that references calibrate.
        library_file: Of the user's own effects, if the library has any.

    """
    known = diagnosis.verdict in {Verdict.EFFECTS, Verdict.AMBIGUOUS}
    values = {
        f"{effect.name}.{parameter.name}": parameter.value
        for effect in (diagnosis.effects if known else ())
        for parameter in effect.parameters
    }
    said = [f"# {diagnosis.verdict.value}: {words.headline(diagnosis)}"]
    if not diagnosis.finished:
        said.append("# The diagnosis was stopped early: this is provisional.")
    lines = constant_lines(diagnosis, problem.constants)
    if lines:
        said.append("# Calibrated to the references, and not loaded from here; standard deviations are of the prior:")
    said += [
        f"#   {line['name']}: {line['value']}, nominal {line['nominal']} ({line['deviations']} standard deviations)"
        for line in lines
    ]
    return "\n".join([*said, corrected_text(problem.library, values, library_file if values else None)])
