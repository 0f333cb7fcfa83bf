"""What stands in for each row, claim and curve of the paper: a rig and its options."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from jammkle_graph.parameters import from_mapping
from jammkle_sim.paper_tables import DROP_ROWS, DROP_TEST, SLIP_TEST, TENSILE_ROWS, TENSILE_TEST
from jammkle_sim.rigs.catalogue import rig_kind

if TYPE_CHECKING:
    from collections.abc import Mapping

    from jammkle_graph.parameters import Value

PARAMETER_SETS = ("fitted", "as_printed")
"""Both are run, in this order."""

MATERIALS = {"multi": "multi-material", "a30": "Shore A-30", "a85": "Shore A-85"}
"""What tendons were printed of, with a name for people."""

VACUUMS_KPA = (0, 10, 30, 50)
"""Vacuums of the paper's force-displacement curves."""

RIG_OF_TEST = {TENSILE_TEST: "tensile", DROP_TEST: "drop", SLIP_TEST: "slip"}
PEAK_OF_TEST = {TENSILE_TEST: "peak_force_n", DROP_TEST: "peak_deceleration_m_s2", SLIP_TEST: "peak_before_heel_n"}
"""Which of a rig's results stands beside the paper's number; in the slip test, beside what it claims."""

PEAK_OF_DESCENT, ENERGY = "peak_force_n", "energy_n_m"
"""The slip rig's other results: peak of the whole descent, N, and work of the push over it, J."""


@dataclass(frozen=True)
class Experiment:
    """One setting of one rig."""

    identifier: str
    """Of the row, where it stands for one."""
    test: str
    title: str
    values: Mapping[str, Value] = field(default_factory=dict)
    """Options of the rig that differ from its defaults."""

    @property
    def rig(self) -> str:
        """Name of the rig."""
        return RIG_OF_TEST[self.test]

    def options(self, parameter_set: str, seed: int) -> Any:
        """Return the options of the rig before scatter."""
        values = {**self.values, "parameter_set": parameter_set, "seed": seed}
        return from_mapping(rig_kind(self.rig).options, values)


_TENSILE_VALUES: dict[str, dict[str, Value]] = {
    "no_membrane_atm": {"membrane": "no"},
    "membrane_atm": {},
    "a30_atm": {"material": "a30"},
    "a30_vac50": {"material": "a30", "vacuum_pa": 50e3},
    "a85_atm": {"material": "a85"},
    "a85_vac50": {"material": "a85", "vacuum_pa": 50e3},
    "multi_vac10": {"vacuum_pa": 10e3},
    "multi_vac30": {"vacuum_pa": 30e3},
    "multi_vac50": {"vacuum_pa": 50e3},
}
_DROP_FEET = {
    "rigid_ankle": "rigid_ankle",
    "standard_foot": "standard",
    "squash_ball": "squash_ball",
    "jammed_ankle": "jammed",
    "unjammed_ankle": "unjammed",
}

ROW_EXPERIMENTS = (
    *(Experiment(row.identifier, row.test, row.title, _TENSILE_VALUES[row.identifier]) for row in TENSILE_ROWS),
    *(Experiment(row.identifier, row.test, row.title, {"foot": _DROP_FEET[row.identifier]}) for row in DROP_ROWS),
)
"""One per row of the tables."""

SLIP_RIGID, SLIP_UNJAMMED, SLIP_JAMMED = (
    Experiment("slip_rigid_ankle", SLIP_TEST, "Rigid ankle", {"foot": "rigid_ankle"}),
    Experiment("slip_unjammed_ankle", SLIP_TEST, "Unjammed ankle", {"foot": "unjammed"}),
    Experiment("slip_jammed_ankle", SLIP_TEST, "Jammed ankle", {"foot": "jammed"}),
)
SLIP_EXPERIMENTS = (SLIP_RIGID, SLIP_UNJAMMED, SLIP_JAMMED)
"""What the claims of the slip test compare."""

CURVE_EXPERIMENTS = tuple(
    Experiment(
        f"{material}_vac{kpa}",
        TENSILE_TEST,
        f"{name[0].upper()}{name[1:]}, -{kpa} kPa",
        {"material": material, "vacuum_pa": kpa * 1e3},
    )
    for material, name in MATERIALS.items()
    if material != "multi"
    for kpa in VACUUMS_KPA
    if f"{material}_vac{kpa}" not in _TENSILE_VALUES and kpa
)
"""Curves that belong to no row: run once each, without scatter."""


def curve_identifier(material: str, vacuum_kpa: int) -> str:
    """Return which experiment gives the curve of a material at a vacuum."""
    if vacuum_kpa:
        return f"{material}_vac{vacuum_kpa}"
    return "membrane_atm" if material == "multi" else f"{material}_atm"
