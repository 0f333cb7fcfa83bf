"""The trial on any robot: machines have what they are given, and what is true can be found in them."""

from __future__ import annotations

import numpy as np
import pytest

from studies.any_robot.__main__ import figures
from studies.any_robot.machines import OUTSIDE, ROBOTS, SINGLES, Fault, able, machine_of, put_fault, record


@pytest.mark.parametrize("robot", sorted(ROBOTS))
def test_every_fault_shows_in_what_is_recorded(robot: str) -> None:
    """The same machine in the same motion, with the same noise, reads otherwise with each fault."""
    plain = record(robot, machine_of(robot, 0.0, np.random.default_rng(1)), Fault(), 1.5, np.random.default_rng(2))
    for what in (*SINGLES, *OUTSIDE):
        if not able(robot, what):
            continue
        model, fault = machine_of(robot, 0.0, np.random.default_rng(1)), Fault()
        put_fault(fault, model, robot, what, np.random.default_rng(5))
        made = record(robot, model, fault, 1.5, np.random.default_rng(2))
        assert fault.label.startswith("delay" if "delay" in what else what)
        assert what in OUTSIDE or fault.sizes[fault.label]
        assert fault.names == ((fault.label,) if what in SINGLES else ())
        steps = [np.abs(made[f"{name}.position"] - plain[f"{name}.position"]).max() for name in ROBOTS[robot].measured]
        efforts = [np.abs(made[f"{name}.effort"] - plain[f"{name}.effort"]).max() for name in ROBOTS[robot].driven]
        assert max(steps) > 2.0 * ROBOTS[robot].step or max(efforts) > 0.2 * ROBOTS[robot].effort_noise, what


def test_figures_count_what_they_say() -> None:
    """A right name, a wrong one for certain, and a cause outside the library, each in its own row."""
    case = {"kind": "single", "nameable": True, "truth": ["a"], "first": ["a"], "named": [["a"]], "verdict": "EFFECTS",
            "rms": "b", "bic": ["a", "b"], "largest": "a", "closed": 0.5}  # fmt: skip
    wrong = {**case, "first": ["b"], "named": [["b"]]}
    outside = {**case, "kind": "outside", "truth": [], "verdict": "UNKNOWN", "first": [], "named": [[]]}
    table = figures([case, wrong, outside])
    assert "| single effects, first | 1 of 2 |" in table
    assert "| named for certain, and wrong | 1 of 2 |" in table
    assert "none of them in the set | 1 of 1 |" in table
    assert "all that stepwise BIC takes | 0 of 2 |" in table
