"""`jammkle gap blind baselines`: what simpler methods say of the same bags."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jammkle_bringup import report
from jammkle_bringup.core.gap.backend import backend
from jammkle_bringup.core.signals import StopRequest
from jammkle_bringup.gap_diagnosing import failures_told
from jammkle_bringup.gap_inputs import library_of, recordings_of, rig_options
from jammkle_sim.gap.ankle.simulator import AnkleSimulator
from jammkle_sim.gap.baselines import baselines as rank

if TYPE_CHECKING:
    from jammkle_bringup.gap import DiagnoseRequest

_SHOWN = 5


def baselines(request: DiagnoseRequest) -> int:
    """Rank effects in three simple ways, show the first of each, and return the exit code.

    Raises:
        InputError: a bag or an option cannot be used.
        GraphError: the simulator fails.
        Interrupted: asked to stop.

    """
    report.check_writable(request.json)
    options, stop, library = rig_options(request.settings), StopRequest(), library_of(request.library)
    recordings = recordings_of(request.bags, request.rig, options, stop)
    references = recordings_of(request.references, request.rig, options, stop)
    with failures_told(), backend(request.jobs, request.scheduler) as jobs:
        found = rank(recordings, AnkleSimulator(library), library, references=references, jobs=jobs, stop=stop)
    ranked = {"rmse": found.rmse, "bic": found.bic, "free": found.free}
    for name, names in ranked.items():
        report.console().print(f"{name}: {', '.join(names[:_SHOWN]) or 'no effect'}", markup=False)
    content = {
        "baselines": {name: list(names[:_SHOWN]) for name, names in ranked.items()},
        "runtime": {"wall_s": found.spent.wall_s, "simulator_runs": found.spent.runs},
    }
    report.write_json(request.json, content)
    return 0
