"""Air and tendons of the reality: what physics demands of them, and the paper's table."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np
import pytest

from jammkle_common import names
from studies.blind.reality.air import (
    NODES,
    advance_air,
    air_law,
    breathe,
    nozzle_kg_s,
    pressures_pa,
    together,
    tube_kg_s,
    vented,
)
from studies.blind.reality.machine import ROOM_K, Machine, TendonMake, conductance_dm3_s_bar, nozzle_area_m2
from studies.blind.reality.sensors import Plan
from studies.blind.reality.tendon import TendonState, tendon_history, tendon_law, tendon_state
from studies.blind.reality.tensile import tensile
from studies.paper.tables import TENSILE_ROWS, PaperRow

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from studies.blind.reality.sensors import Option

STEP_S = 5e-4
SETTINGS: dict[str, dict[str, Option]] = {
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


def pulled(
    extension_m: NDArray[np.float64], vacuum_pa: float, make: TendonMake | None = None, step_s: float = STEP_S
) -> tuple[NDArray[np.float64], TendonState]:
    """Pull a tendon through a history."""
    law = tendon_law(make or TendonMake(), step_s)
    state, tension_n = tendon_state(law, 0.0), np.zeros(len(extension_m))
    tendon_history(law, state, extension_m, np.full(len(extension_m), vacuum_pa), tension_n)
    return tension_n, state


def there_and_back(extension_m: float, speed_m_s: float, step_s: float = STEP_S) -> NDArray[np.float64]:
    up = np.arange(0.0, extension_m, speed_m_s * step_s)
    return np.concatenate([up, up[::-1]])


@pytest.mark.parametrize("row", TENSILE_ROWS, ids=lambda row: row.identifier)
def test_the_machine_as_calibrated_pulls_within_the_papers_error_bars(row: PaperRow) -> None:
    """A machine without scatter, run like a real one, gives each mean peak force within one standard error."""
    found = tensile(Plan("tensile", SETTINGS[row.identifier]), Machine(), 0)
    force_n = found.topics[names.LOAD_CELL.name].values[:, 2]
    peak_n = np.convolve(force_n, np.full(11, 1.0 / 11.0), "valid").max()
    assert abs(peak_n - row.mean) <= row.standard_error


@pytest.mark.parametrize("vacuum_pa", [0.0, 10e3, 20e3, 30e3, 50e3])
def test_a_tendon_gives_back_less_than_it_takes(vacuum_pa: float) -> None:
    """Every closed cycle, the second one as well, loses energy."""
    once = there_and_back(0.02, 0.02)
    x = np.concatenate([once, once])
    tension_n, _ = pulled(x, vacuum_pa)
    for part in (slice(0, len(once)), slice(len(once), None)):
        assert np.trapezoid(tension_n[part], x[part]) > 0.01


def test_the_loss_is_largest_where_all_contacts_slide() -> None:
    """Half jammed, a cycle loses a larger share than vented or fully jammed."""
    x = there_and_back(0.02, 0.005)
    half = len(x) // 2
    lost = {}
    for vacuum_pa in (0.0, 20e3, 30e3, 50e3):
        tension_n, _ = pulled(x, vacuum_pa)
        lost[vacuum_pa] = np.trapezoid(tension_n, x) / np.trapezoid(tension_n[:half], x[:half])
    assert min(lost[20e3], lost[30e3]) > max(lost[0.0], lost[50e3])


def test_a_vented_tendon_slides_freely_and_a_jammed_one_holds() -> None:
    """Without vacuum no contact carries anything and all slices carry the same; with it, they do not."""
    x = there_and_back(0.02, 0.02)[: round(0.9 / STEP_S)]
    _, vented_state = pulled(x, 0.0)
    _, jammed_state = pulled(x, 50e3)
    assert np.abs(vented_state.bristle_n).max() == 0.0
    assert np.abs(jammed_state.bristle_n).max() > 1.0


def test_every_step_ends_in_balance() -> None:
    """The force left over at the nodes is tiny after every step, slow or fast, jammed or not."""
    for speed_m_s, step_s in ((0.005, 5e-4), (1.0, 1e-4)):
        law = tendon_law(TendonMake(), step_s)
        state, tension_n = tendon_state(law, 0.0), np.zeros(1)
        for place_m in there_and_back(0.03, speed_m_s, step_s)[::1]:
            tendon_history(law, state, np.array([place_m]), np.array([40e3]), tension_n)
            assert state.more[2] < 1e-6


def test_the_force_does_not_hang_on_the_time_step() -> None:
    """Ten times the step moves the peak by less than a percent."""
    peaks = [pulled(there_and_back(0.02, 0.05, step_s), 50e3, step_s=step_s)[0].max() for step_s in (1e-3, 1e-4)]
    assert peaks[0] == pytest.approx(peaks[1], rel=0.01)


def test_force_relaxes_by_a_power_of_time() -> None:
    """Held, it falls by about as much from 0.1 to 1 s as theory says, and falls on from 1 to 10 s."""
    step_s = 1e-3
    held = np.concatenate([np.linspace(0.0, 0.01, 3), np.full(10_000, 0.01)])
    tension_n, _ = pulled(held, 0.0, step_s=step_s)
    make = TendonMake()
    at = {after_s: tension_n[3 + round(after_s / step_s)] for after_s in (0.1, 1.0, 9.0)}
    assert at[0.1] > at[1.0] > at[9.0] > 0.0
    same = dataclasses.replace(make, stiff=dataclasses.replace(make.stiff, relaxation=make.soft.relaxation))
    tension_n, _ = pulled(held, 0.0, same, step_s)
    kept = {after_s: 1.0 + make.soft.relaxation * after_s**-make.exponent for after_s in (0.1, 1.0)}
    assert tension_n[102] / tension_n[1002] == pytest.approx(kept[0.1] / kept[1.0], rel=0.06)


def test_it_tears_for_good() -> None:
    """Beyond the paper's 55 mm the force is gone and does not come back; slack it pulls nothing."""
    tension_n, state = pulled(there_and_back(0.06, 0.5), 0.0)
    first = int(np.argmax(there_and_back(0.06, 0.5) >= 0.055))
    assert tension_n[first - 1] > 50.0
    assert np.all(tension_n[first:] == 0.0)
    assert state.more[1] == 1.0
    slack, _ = pulled(np.linspace(0.0, -0.01, 100), 50e3)
    assert np.all(slack[1:] == 0.0)


def breathing(lift: float, duty: float, steps: int = 40_000) -> tuple[float, float, NDArray[np.float64]]:
    """Empty and fill; return what is amiss in mass and heat, relative, and the pressures."""
    law = air_law(Machine().air)
    state = vented(law)
    mass_kg, heat_j = state.mass_kg.sum(), state.heat_j.sum()
    state.goal[:] = lift
    state.more[0] = duty
    history = np.zeros((steps // 10 + 1, NODES))
    advance_air(law, state, 0, steps, 10, history)
    state.goal[0] = 1.0 - lift
    advance_air(law, state, steps, 2000, steps, history)
    left_kg = state.mass_kg.sum() - mass_kg - state.more[2] + state.more[3]
    left_j = state.heat_j.sum() - heat_j - state.more[4]
    return left_kg / mass_kg, left_j / heat_j, pressures_pa(law, state)


def test_air_and_heat_are_accounted_for() -> None:
    """What is in the volumes is what was there, came in and went out, to the last digits."""
    for lift, duty in ((1.0, 1.0), (0.0, 0.5), (0.4, 1.0)):
        mass, heat, pressure_pa = breathing(lift, duty)
        assert abs(mass) < 1e-11
        assert abs(heat) < 1e-11
        assert np.all(pressure_pa > 15e3)
        assert np.all(pressure_pa < 101_400.0)


def test_a_nozzle_chokes() -> None:
    """Below the critical ratio the flow no longer grows, without a difference there is none, and it never jumps."""
    area_m2 = nozzle_area_m2(0.1)
    assert conductance_dm3_s_bar(area_m2) == pytest.approx(0.1)
    choked = nozzle_kg_s(area_m2, 1e5, ROOM_K, 0.0)
    assert choked == pytest.approx(0.1e-8 * 1.185 * 1e5)
    assert nozzle_kg_s(area_m2, 1e5, ROOM_K, 0.4e5) == choked
    assert nozzle_kg_s(area_m2, 1e5, ROOM_K, 1e5) == 0.0
    flows = [nozzle_kg_s(area_m2, 1e5, ROOM_K, share * 1e5) for share in np.linspace(0.0, 1.0, 2001)]
    assert np.all(np.diff(flows) <= 1e-18)
    assert np.abs(np.diff(flows)).max() < 0.02 * choked


def test_a_tube_loses_pressure_to_its_flow() -> None:
    """The flow that is returned costs the pressure that was given, laminar and turbulent together."""
    line = Machine().air.lines[0]
    for difference_pa in (1.0, 100.0, 1e4):
        flow = tube_kg_s(line.laminar_per_m_s, line.turbulent_per_m4, 0.8, difference_pa)
        lost_pa = (line.laminar_per_m_s * flow + line.turbulent_per_m4 * flow**2) / 0.8
        assert lost_pa == pytest.approx(difference_pa)


def test_air_cools_as_it_expands() -> None:
    """A valve that opens to a vacuum leaves cold air, which the walls warm up again."""
    law = air_law(Machine().air)
    state = vented(law)
    state.more[0], state.goal[:] = 1.0, 1.0
    history = np.zeros((1, NODES))
    advance_air(law, state, 0, 3000, 10_000, history)
    coldest = (state.heat_j / state.mass_kg).min()
    before = (vented(law).heat_j / vented(law).mass_kg).min()
    assert coldest < 0.995 * before
    state.more[0] = 0.0
    advance_air(law, state, 3000, 40_000, 100_000, history)
    assert (state.heat_j / state.mass_kg).min() > 0.999 * before


def test_the_pump_holds_what_the_paper_says() -> None:
    """All four tendons are within 1 kPa of -50 kPa in under half a second, and vented in under a fifth."""
    schedule = (*together(0.1, names.CHANNELS, 50e3), *together(1.1, names.CHANNELS, 0.0))
    air = breathe(Machine(), schedule, 1.6, 0)
    shallowest, deepest = air.vacuum_pa.min(axis=1), air.vacuum_pa.max(axis=1)
    reached_s = air.time_s[int(np.argmax(shallowest > 49e3))] - 0.1
    gone_s = air.time_s[int(np.argmax((air.time_s > 1.1) & (deepest < 5e3)))] - 1.1
    assert 0.2 < reached_s < 0.5
    assert 0.02 < gone_s < 0.2
    holding = (air.time_s > 0.9) & (air.time_s < 1.1)
    assert np.abs(air.vacuum_pa[holding] - 50e3).max() < 1e3
