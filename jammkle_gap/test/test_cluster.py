"""`jammkle gap diagnose --scheduler`: the runs go to a Dask cluster, and the answer stays the same."""

from __future__ import annotations

import json
import os
import signal
from typing import TYPE_CHECKING, Any

import pytest
from distributed import LocalCluster

from jammkle_common.command.main import main
from jammkle_gap import diagnosing as gap_diagnosing

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

OFFERED = ("valve_dead_time", "line_leak_achilles")
"""Effects on offer: few, so that a busy machine is done in time."""


@pytest.fixture
def cluster() -> Iterator[LocalCluster]:
    """Start a cluster of two worker processes on this machine."""
    with LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as started:
        yield started


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_a_cluster_that_loses_a_worker_gives_the_same_answer(
    cluster: LocalCluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With one of two workers killed half-way, verdict, effects, values and runs are those of this machine alone.

    Each of the two simulates its signatures anew, so that the cluster makes them too.
    """
    bag, whole = tmp_path / "slow", gap_diagnosing.diagnose_recordings
    rig = ["rig", "pressure", "--cycles", "2", "--jam-time-s", "0.8", "--vent-time-s", "0.4", "--channel", "achilles"]
    (tmp_path / "late.yaml").write_text("valve_dead_time_s: 0.05\n", encoding="utf-8")
    assert main([*rig, "--params", str(tmp_path / "late.yaml"), "-o", str(bag)]) == 0
    (bag / "run.yaml").write_text("options: {valve_dead_time_s: 0.01}", encoding="utf-8")
    killed: list[int] = []

    def losing_a_worker(*arguments: Any, progress: Callable[[str, float], None], **options: Any) -> Any:
        def report_and_kill(stage: str, share: float) -> None:
            progress(stage, share)
            if stage == "fitting" and not killed:
                killed.append(next(iter(cluster.workers.values())).pid)
                os.kill(killed[0], signal.SIGKILL)

        return whole(*arguments, progress=report_and_kill, **options)

    found = []
    offered = [part for name in OFFERED for part in ("--only", name)]
    for name, options in (("here", ["--jobs", "1"]), ("there", ["--scheduler", cluster.scheduler_address])):
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / f"cache_{name}"))
        if name == "there":
            monkeypatch.setattr(gap_diagnosing, "diagnose_recordings", losing_a_worker)
        said = ["-o", str(tmp_path / name), "--json", str(tmp_path / f"{name}.json")]
        assert main(["gap", "diagnose", str(bag), *offered, *options, *said]) == 0
        # Sums of floats depend in their last digits, and so do zeros, on how many threads a process has.
        text = (tmp_path / f"{name}.json").read_text(encoding="utf-8")
        found.append(json.loads(text, parse_float=lambda number: round(float(f"{float(number):.5g}"), 12)))
    assert killed
    for key in ("verdict", "effects", "set", "posterior", "gap"):
        assert found[0][key] == found[1][key]
    # Lost runs are made again without being counted twice; by the last digits a fit may take a step more.
    assert found[0]["runtime"]["simulator_runs"] == pytest.approx(found[1]["runtime"]["simulator_runs"], rel=0.01)


def test_a_scheduler_that_is_not_there_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """An address at which nobody answers is refused with exit code 2 and one line that names it."""
    monkeypatch.setattr("jammkle_gap.backend.ANSWER_S", 0.5)
    bag = tmp_path / "short"
    assert main(["rig", "pressure", "--cycles", "2", "-o", str(bag)]) == 0
    capsys.readouterr()
    assert main(["gap", "diagnose", str(bag), "--scheduler", "tcp://127.0.0.1:1", "-o", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err.splitlines()
    assert "tcp://127.0.0.1:1 does not answer" in error[-1]
