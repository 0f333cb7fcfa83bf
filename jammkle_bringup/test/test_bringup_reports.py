"""`jammkle status`: until when it waits for the nodes' reports."""

from __future__ import annotations

from jammkle_bringup.channel_commands import all_reported
from jammkle_bringup.conversions import HealthStatus
from jammkle_common.diagnostics import LIVENESS_LINE, MISSED_AFTER_S, SILENT_FOR

DRIVERS = ("/lf_ankle/driver", "/rf_ankle/driver")


def lines(*nodes: str, **silent_s: float) -> dict[str, HealthStatus]:
    """Return reports of nodes; each says how long those given have been silent, which it knows by relative names."""
    values = {f"{name}{SILENT_FOR}": f"{each:.1f}" for name, each in silent_s.items()}
    return {f"{node}{LIVENESS_LINE}": HealthStatus(f"{node}{LIVENESS_LINE}", "OK", "", values) for node in nodes}


def test_every_driver_and_all_that_they_know_is_waited_for() -> None:
    """A driver that has not reported, or a node that another one receives, is still to come."""
    assert not all_reported({}, DRIVERS)
    assert not all_reported(lines(DRIVERS[0]), DRIVERS)
    assert all_reported(lines(*DRIVERS), DRIVERS)
    known = lines(*DRIVERS, controller=0.5)
    assert not all_reported(known, DRIVERS)
    assert not all_reported(known | lines("/lf_ankle/controller"), DRIVERS)
    assert all_reported(known | lines("/lf_ankle/controller", "/rf_ankle/controller"), DRIVERS)


def test_the_simulation_above_is_known_by_its_whole_name() -> None:
    """A robot's simulation stands outside the ankle's namespace."""
    known = lines(*DRIVERS, **{"/sim": 0.1})
    assert not all_reported(known, DRIVERS)
    assert all_reported(known | lines("/sim"), DRIVERS)


def test_the_dead_are_not_waited_for() -> None:
    """Whom the others miss already will not report: to wait for it would take seconds, each time."""
    assert all_reported(lines(*DRIVERS, controller=MISSED_AFTER_S + 0.1), DRIVERS)
