"""What is compared: recordings beside the nominal simulator, in units of a noise, less what references say anyway."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from jammkle_gap.november.references import beside_references, with_references, without_references
from jammkle_gap.november.repeats import leaders
from jammkle_gap.november.residual import lay_out
from jammkle_gap.november.runs import Runs

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    import numpy as np
    from numpy.typing import NDArray

    from jammkle_gap.november.recording import Recording
    from jammkle_gap.november.references import Baseline
    from jammkle_gap.november.residual import Layout
    from jammkle_gap.november.simulator import Simulator


@dataclass(frozen=True)
class Compared:
    """Recordings and the nominal simulator, ready for effects to be tried."""

    runs: Runs
    nominal: list[dict[str, NDArray[np.float64]]]
    """Of the simulator, per recording."""
    baseline: Baseline
    layout: Layout
    references: Sequence[Recording]

    @property
    def noise(self) -> Mapping[str, float]:
        """Standard deviation per signal, in its unit."""
        return {name: source.noise for name, source in self.baseline.noise.items()}

    def beside(
        self, simulate: Callable[[Recording], Mapping[str, NDArray[np.float64]]]
    ) -> list[dict[str, NDArray[np.float64]]]:
        """Return what another simulator makes of the recordings, as the residual takes it.

        What it is off of the references is its own, and is no gap.
        """
        own, others = (
            [self.runs.counted(simulate(each), each) for each in recordings]
            for recordings in (self.runs.recordings, self.references)
        )
        return beside_references(self.runs.recordings, own, self.references, others, self.baseline)


def compare(
    recordings: Sequence[Recording],
    simulator: Simulator,
    references: Sequence[Recording],
    jobs: int | None,
    stop: Callable[[], bool],
) -> Compared:
    """Run the simulator without any effect, and lay out what can be compared.

    Args:
        recordings: What was measured.
        simulator: Runs a recording again.
        references: Of the same machine in good order; none, and nothing is taken off.
        jobs: Processes.
        stop: Asked now and then; True ends it with StoppedError.

    Raises:
        BadRecordingError: the recordings cannot be used.
        StoppedError: stopped.

    """
    runs = Runs(simulator, recordings, jobs=jobs, stop=stop)
    nominal = runs.nominal()
    if references:
        healthy = Runs(simulator, references, jobs=jobs, stop=stop).nominal()
        baseline = with_references(recordings, nominal, references, healthy)
    else:
        baseline = without_references(recordings, nominal)
    noise = {name: source.noise for name, source in baseline.noise.items()}
    runs.lead(leaders(recordings, nominal, noise))
    hanging = {name: source.factor for name, source in baseline.noise.items()}
    layout = lay_out(
        recordings,
        nominal,
        noise,
        corrections=baseline.corrections,
        added=baseline.added,
        factors=hanging,
        off=baseline.off,
    )
    return Compared(runs, nominal, baseline, layout, references)
