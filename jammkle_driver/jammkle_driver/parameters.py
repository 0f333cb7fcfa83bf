"""Parameters of the driver: the one table from which they are declared, bounded, validated and documented."""

from __future__ import annotations

from dataclasses import dataclass

from jammkle_common.constants import HELD_VACUUM_PA, STANDARD_ATMOSPHERE_PA
from jammkle_common.names import CHANNELS, TENDONS_OF_CHANNEL
from jammkle_common.parameters import ParameterError, parameter
from jammkle_driver.core.air import AirSettings

TICK_PERIOD_S = 0.05
"""Actuator commands are repeated, and silences looked for, this often on the steady clock, s."""


@dataclass(frozen=True)
class DriverParameters:
    """Parameters of the driver node.

    Set points: the paper holds -50 kPa; the pump assumed for the simulation ends at -80 kPa, and takes 1.3 s to pull
    four tendons to -70 kPa. Times: four tendons reach -50 kPa in 0.5 s and vent in 0.15 s on the assumed pneumatics;
    the limits leave a factor of six. Gains: tuned on these pneumatics for less than 1 kPa of overshoot.
    """

    autostart: bool = parameter(default=True, description="Configure and activate the node by itself at start")
    hardware: str = parameter(
        "sim",
        "What is driven; sim: the topics of the simulation; modbus: a board; fake: an ankle of plain numbers in "
        "process, whose faults fake_faults says; or a name that an installed package "
        "brings along (entry point of jammkle.hardware)",
    )
    port: str = parameter(
        "",
        "Where the board is: a serial device, best its /dev/serial/by-id name or the udev rule's /dev/jammkle_board, "
        "or tcp://HOST[:PORT]",
    )
    board_file: str = parameter("", "YAML file that says how the board is wired; empty: config/board.yaml")
    fake_faults: str = parameter(
        "",
        "For hardware fake: what fails when, one line each (or separated by ;) of TIME_S FAULT [PLACE [SIZE]], or a "
        "file of such lines",
    )
    safe_state: str = parameter(
        "vent",
        "What jammed tendons do at a stop, a fault, or when their commands fall silent; vent: soften; hold: stay "
        "connected, pump off",
        choices=("vent", "hold"),
    )
    fault_policy: str = parameter(
        "ankle",
        "What a fault of one channel means for the others; ankle: all go to the safe state, as an ankle that is stiff "
        "on one side turns the foot; channel: the others go on",
        choices=("ankle", "channel"),
    )
    diagnose: bool = parameter(
        default=True,
        description="Find faults and the pressure of the atmosphere from commands and pressures by the law of the air; "
        "false: by time-outs alone",
    )
    ambient_pressure_pa: float = parameter(
        STANDARD_ATMOSPHERE_PA,
        "Pressure of the atmosphere, from which vacuum is counted until two vented channels show it",
        "Pa",
        50e3,
        110e3,
        dynamic=True,
    )
    default_vacuum_pa: float = parameter(
        HELD_VACUUM_PA, "Vacuum of a jam request that names none", "Pa", 1e3, 100e3, dynamic=True
    )
    min_vacuum_pa: float = parameter(5e3, "Least vacuum that may be asked for", "Pa", 1e3, 100e3)
    max_vacuum_pa: float = parameter(70e3, "Most vacuum that may be asked for", "Pa", 1e3, 100e3)
    tolerance_pa: float = parameter(
        2e3, "Distance from the set point, on both sides, within which a channel is JAMMED", "Pa", 100.0, 20e3
    )
    hysteresis_pa: float = parameter(
        4e3, "How far above vented_vacuum_pa it must go to leave UNJAMMED", "Pa", 0.0, 20e3
    )
    vented_vacuum_pa: float = parameter(5e3, "Vacuum below which a channel is UNJAMMED", "Pa", 100.0, 20e3)
    jam_timeout_s: float = parameter(
        3.0,
        "Longest time that a channel asked to jam may not be JAMMED, or take the pump's full duty, before FAULT; the "
        "time in which the pump evacuates the reservoir is added",
        "s",
        0.05,
        60.0,
    )
    vent_timeout_s: float = parameter(
        1.0, "Longest time until a channel asked to unjam is vented, before FAULT", "s", 0.05, 60.0
    )
    command_timeout_s: float = parameter(
        0.5, "Silence of jam_command after which what it jammed is vented", "s", 0.05, 60.0
    )
    pressure_timeout_s: float = parameter(0.5, "Silence of a pressure topic before FAULT", "s", 0.05, 60.0)
    emergency_stop_timeout_s: float = parameter(
        0.0, "Silence of any publisher of emergency_stop that is a stop; 0: silence is none", "s", 0.0, 60.0
    )
    regulator_gain_per_pa: float = parameter(2.5e-4, "Pump duty per Pa of missing vacuum", "1/Pa", 1e-6, 1e-2)
    regulator_integral_time_s: float = parameter(
        0.5, "Time in which the regulator's integral repeats its proportional part", "s", 0.01, 60.0
    )
    manifold_lead_pa: float = parameter(
        2e3, "How much deeper than the set point the manifold may be while tendons follow", "Pa", 0.0, 20e3
    )
    pump_rest_band_pa: float = parameter(
        700.0, "How far the vacuum may fall before a resting pump works again", "Pa", 100.0, 5e3
    )
    pump_rated_duty: float = parameter(
        0.6,
        "Mean duty that the pump bears for ever; 1: no limit. Assumed, as for small diaphragm pumps",
        "1",
        0.05,
        1.0,
    )
    pump_thermal_time_s: float = parameter(60.0, "Time constant in which the pump warms up. Assumed", "s", 1.0, 3600.0)
    manifold_volume_m3: float = parameter(15e-6, "Manifold and the hose to the pump", "m^3", 1e-7, 1e-2)
    reservoir_volume_m3: float = parameter(
        0.0, "Reservoir between pump and manifold, evacuated while all valves are shut; 0: none", "m^3", 0.0, 1e-2
    )
    stored_vacuum_pa: float = parameter(
        60e3, "Vacuum to which the reservoir is evacuated while nothing is jammed", "Pa", 5e3, 100e3
    )
    tendon_volume_m3: float = parameter(6e-6, "Free air in one tendon with its share of hose", "m^3", 1e-7, 1e-2)
    valve_conductance_m3_s_pa: float = parameter(
        1e-9, "Sonic conductance of solenoid and hose in series (1e-8 is 1 dm^3/(s bar))", "m^3/(s Pa)", 1e-12, 1e-6
    )
    leak_conductance_m3_s_pa: float = parameter(
        1e-12, "Sonic conductance of a good membrane's leak", "m^3/(s Pa)", 1e-15, 1e-9
    )
    pump_free_flow_m3_s: float = parameter(
        1e-4, "Volume that the pump draws at full duty without vacuum", "m^3/s", 1e-7, 1e-2
    )
    pump_ultimate_vacuum_pa: float = parameter(80e3, "Vacuum at which the pump stops drawing", "Pa", 10e3, 101e3)
    valve_dead_time_s: float = parameter(0.010, "Time from command to a valve's movement", "s", 0.0, 0.2)

    def __post_init__(self) -> None:
        """Check what one row alone cannot.

        Raises:
            ParameterError: min_vacuum_pa is above max_vacuum_pa, or default_vacuum_pa not between them, the pump cannot
                reach max_vacuum_pa, no vacuum at all would be near enough to min_vacuum_pa, or a resting pump lets the
                vacuum fall out of the tolerance.

        """
        for name, vacuum_pa in (("max_vacuum_pa", self.max_vacuum_pa), ("stored_vacuum_pa", self.reservoir_vacuum_pa)):
            if vacuum_pa >= self.pump_ultimate_vacuum_pa:
                msg = (
                    f"parameter '{name}' is {vacuum_pa:g}; it must be below pump_ultimate_vacuum_pa, "
                    f"here {self.pump_ultimate_vacuum_pa:g} Pa, which the pump never exceeds"
                )
                raise ParameterError(msg)
        if self.tolerance_pa >= self.min_vacuum_pa:
            msg = (
                f"parameter 'tolerance_pa' is {self.tolerance_pa:g}; it must be below min_vacuum_pa, "
                f"here {self.min_vacuum_pa:g} Pa, else a channel without vacuum would count as JAMMED"
            )
            raise ParameterError(msg)
        if self.pump_rest_band_pa >= self.tolerance_pa:
            msg = (
                f"parameter 'pump_rest_band_pa' is {self.pump_rest_band_pa:g}; it must be below tolerance_pa, "
                f"here {self.tolerance_pa:g} Pa, else a channel would leave JAMMED before the pump works again"
            )
            raise ParameterError(msg)
        if self.min_vacuum_pa > self.max_vacuum_pa:
            msg = (
                f"parameter 'min_vacuum_pa' is {self.min_vacuum_pa:g}; it must be at most max_vacuum_pa, "
                f"here {self.max_vacuum_pa:g} Pa"
            )
            raise ParameterError(msg)
        if not self.min_vacuum_pa <= self.default_vacuum_pa <= self.max_vacuum_pa:
            msg = (
                f"parameter 'default_vacuum_pa' is {self.default_vacuum_pa:g}; it must be from min_vacuum_pa "
                f"to max_vacuum_pa, here {self.min_vacuum_pa:g} to {self.max_vacuum_pa:g} Pa"
            )
            raise ParameterError(msg)

    @property
    def holds(self) -> bool:
        """Whether the safe state keeps solenoids as they are, the pump off."""
        return self.safe_state == "hold"

    @property
    def fails_alone(self) -> bool:
        """Whether the other channels go on when one fails."""
        return self.fault_policy == "channel"

    @property
    def longest_jam_s(self) -> float:
        """`jam_timeout_s`, and the time in which the pump evacuates the reservoir, s."""
        deepest_pa = max(self.max_vacuum_pa, self.reservoir_vacuum_pa)
        return self.jam_timeout_s + self.air().evacuation_s(self.reservoir_volume_m3, deepest_pa)

    @property
    def longest_jam(self) -> str:
        """The same for people, with the name of the limit."""
        beside = ", and the time to evacuate the reservoir" if self.reservoir_volume_m3 > 0.0 else ""
        return f"{self.longest_jam_s:.3g} s (jam_timeout_s{beside})"

    @property
    def reservoir_vacuum_pa(self) -> float:
        """Vacuum to which the reservoir is evacuated while nothing is jammed, Pa; 0: there is none."""
        return self.stored_vacuum_pa if self.reservoir_volume_m3 > 0.0 else 0.0

    def air(self) -> AirSettings:
        """Return the ankle as built."""
        return AirSettings(
            manifold_volume_m3=self.manifold_volume_m3,
            channel_volumes_m3=tuple(self.tendon_volume_m3 * len(TENDONS_OF_CHANNEL[name]) for name in CHANNELS),
            valve_conductance_m3_s_pa=self.valve_conductance_m3_s_pa,
            leak_conductance_m3_s_pa=self.leak_conductance_m3_s_pa,
            pump_free_flow_m3_s=self.pump_free_flow_m3_s,
            pump_ultimate_vacuum_pa=self.pump_ultimate_vacuum_pa,
            valve_dead_time_s=self.valve_dead_time_s,
            reservoir_volume_m3=self.reservoir_volume_m3,
        )
