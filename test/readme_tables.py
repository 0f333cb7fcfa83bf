"""What is made from the code: parts of the pages, the firmware's header of registers, parameter files, versions.

`make readme` writes them; a test fails when they differ. A page says what it wants and where:

    <!-- table: topics -->
    <!-- end of table -->
"""

from __future__ import annotations

import math
import re
import textwrap
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import yaml

from command_reference import command_lines
from jammkle_bringup.core.node_table import AS_BUILT, ROBOT_NODES, NodeEntry
from jammkle_bringup.core.node_table import NODES as NODES_OF_AN_ANKLE
from jammkle_bringup.robot_names import RobotNamesParameters
from jammkle_common import VERSION
from jammkle_common.constants import STANDARD_ATMOSPHERE_PA, STANDARD_GRAVITY_M_S2
from jammkle_common.names import CHANNELS, ROBOT_TOPICS, SERVICES, TOPICS
from jammkle_common.parameters import ParameterClass, ParameterRow, Value, option_name, rows, typed_row
from jammkle_controller.core.events import REASONS, Detection, is_felt
from jammkle_controller.core.landing import LandingModel, travel_m
from jammkle_controller.core.policy import MEANINGS, SET_POINTS, TRANSITIONS, PolicyState
from jammkle_controller.parameters import ControllerParameters
from jammkle_driver.board.wiring import RegisterList, register_list
from jammkle_driver.parameters import DriverParameters
from jammkle_gap.monitor.parameters import GapMonitorParameters
from jammkle_sim.parameters import RobotParameters, SimParameters
from jammkle_sim.physics.pneumatics import PneumaticParameters
from jammkle_sim.rigs.catalogue import RIGS
from jammkle_sim.robots.options import RobotOptions
from jammkle_sim.robots.quadruped import QuadrupedParameters
from jammkle_view.parameters import FoxgloveParameters, ViewerParameters
from pump_bench import Pneumatics

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
EXAMPLES = DOCS / "examples"
CONFIG = ROOT / "jammkle_bringup" / "config"
HEADER = ROOT / "jammkle_driver" / "firmware" / "core" / "registers.h"
OF_THE_DISTRIBUTION = ("numpy", "pyyaml")
"""Requirements that a sourced ROS has by itself."""
NODES: dict[str, type[ParameterClass]] = {
    "driver": DriverParameters,
    "controller": ControllerParameters,
    "sim": SimParameters,
    "sim, of a robot": RobotParameters,
}
ROBOT_VALUES: dict[str, dict[str, object]] = {
    node: {name: getattr(RobotOptions(), option) for each, name, option in AS_BUILT if each == node}
    for node in dict.fromkeys(node for node, *_ in AS_BUILT)
}
"""What fits our robots as they stand better than the default of a node."""
COMMENT = textwrap.TextWrapper(
    119, initial_indent="    # ", subsequent_indent="    # ", break_long_words=False, break_on_hyphens=False
)
OTHER_NODES: dict[str, type[ParameterClass]] = {
    "gap_monitor": GapMonitorParameters,
    "viewer": ViewerParameters,
    "foxglove": FoxgloveParameters,
    "robot_names": RobotNamesParameters,
}


def table(head: tuple[str, ...], lines: list[tuple[str, ...]]) -> str:
    """Markdown table without repeated lines; a bar inside a cell would end the cell, so it is escaped."""
    unique = list(dict.fromkeys(tuple(cell.replace("|", "\\|") for cell in line) for line in lines))
    return "\n".join(
        [f"| {' | '.join(head)} |", f"|{'---|' * len(head)}", *(f"| {' | '.join(line)} |" for line in unique)]
    )


def any_channel(name: str) -> str:
    """Write `<channel>` for the name of a channel at its start."""
    return re.sub(rf"\b({'|'.join(CHANNELS)})/", "<channel>/", name)


def ways_on(state: PolicyState) -> str:
    """What ends a state of the policy, and which one follows."""
    ways: dict[str, list[str]] = {}
    for (left, trigger), following in TRANSITIONS.items():
        if left is state:
            ways.setdefault(following.value, []).append(trigger.value)
    return "<br>".join(f"**{following}**: {'; '.join(triggers)}" for following, triggers in ways.items())


def rig_lines() -> list[tuple[str, ...]]:
    """Options of the rigs: first those that several rigs have in the same way, then what each has for itself."""
    takers: dict[tuple[str, ...], list[str]] = {}
    for rig in RIGS.values():
        for row in rows(rig.options):
            takers.setdefault(option_line(row), []).append(rig.name)
    several = sorted((line for line in takers if len(takers[line]) > 1), key=lambda line: -len(takers[line]))
    alone = [line for line in takers if len(takers[line]) == 1]
    return [(taken_by(takers[line]), *line) for line in [*several, *alone]]


def taken_by(rigs: list[str]) -> str:
    """Names of rigs as a cell of a table."""
    return "every rig" if len(rigs) == len(RIGS) else ", ".join(rigs)


def value_text(value: Value) -> str:
    """Value as it stands in a YAML file."""
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:g}" if isinstance(value, float) else str(value)


def option_line(row: ParameterRow) -> tuple[str, ...]:
    """One line of a table of options: of the command, or of a file alone."""
    name, *rest = parameter_line(typed_row(row))
    return (f"`{option_name(row.name)}`" if row.flag else name, *rest)


def parameter_line(row: ParameterRow) -> tuple[str, ...]:
    """One line of a parameter table."""
    default = f"{value_text(row.default)} {row.unit}".rstrip()
    description = row.description.rstrip(".") + (" (may be changed while running)" if row.dynamic else "")
    return (f"`{row.name}`", default, row.range_text, description)


def tables() -> dict[str, str]:
    """Every part that is made from the code, by the name that a page asks for it by."""
    made = {
        "topics": table(
            ("topic", "type", "delivery", "what"),
            [
                (f"`{any_channel(t.name)}`", f"`{t.message_type}`", t.kind.value, t.note)
                for t in (*TOPICS, *ROBOT_TOPICS)
            ],
        ),
        "services": table(
            ("service", "type", "what"),
            [(f"`{any_channel(s.path)}`", f"`{s.service_type}`", s.note) for s in SERVICES],
        ),
    }
    for node, parameters in NODES.items():
        lines = [parameter_line(row) for row in rows(parameters)]
        if parameters is RobotParameters:
            shared = {parameter_line(row) for row in rows(SimParameters)}
            lines = [line for line in lines if line not in shared]
        made[f"parameters of {node}"] = table(("parameter", "default", "range", "what"), lines)
    made["parameters of other nodes"] = table(
        ("node", "parameter", "default", "range", "what"),
        [(f"`{node}`", *parameter_line(row)) for node, parameters in OTHER_NODES.items() for row in rows(parameters)],
    )
    made["options of rigs"] = table(("rig", "option", "default", "range", "what"), rig_lines())
    made["states of the policy"] = table(
        ("state", "tendons", "meaning", "goes on to"),
        [(state.value, set_point.value, MEANINGS[state], ways_on(state)) for state, set_point in SET_POINTS.items()],
    )
    made["landing vacuum"] = table(
        ("falls on the ankle", *(f"{1e3 * height_m:.0f} mm" for height_m in FALLS_M)),
        [(f"{mass_kg:g} kg", *(landing_cell(height_m, mass_kg) for height_m in FALLS_M)) for mass_kg in FALLING_KG],
    )
    made["jam times"] = table(
        ("reservoir", *(f"{vacuum_pa / 1e3:.0f} kPa" for vacuum_pa in TIMED_PA), "to evacuate it to 60 kPa", "mass"),
        [jam_time_line(volume_ml) for volume_ml in RESERVOIRS_ML],
    )
    made["trot"] = table(
        ("pump, mean duty", *map(reservoir_name, RESERVOIRS_ML)),
        [
            (f"{flow_l_min:g} l/min, {duty:g}", *(trot_cell(flow_l_min, duty, each) for each in RESERVOIRS_ML))
            for flow_l_min, duty in TROTTING
        ],
    )
    made["what is felt"] = table(
        ("event", *(mount.value for mount in REASONS)),
        [
            (
                each.value,
                *(f"{'' if is_felt(mount, each) else '**not reported**: '}{REASONS[mount][each]}" for mount in REASONS),
            )
            for each in Detection
        ],
    )
    made["command"] = table(("verb", "argument or option", "what"), command_lines())
    made["sourced workspace"] = workspace_text()
    made["first session"] = f"```bash\n{(EXAMPLES / 'first_session.sh').read_text()}```"
    for example in EXAMPLES.glob("*.py"):
        made[f"example {example.name}"] = f"```python\n{example.read_text()}```"
    return made


FALLS_M, FALLING_KG, TIMED_PA = (0.02, 0.04, 0.06, 0.08, 0.1, 0.15), (1.8, 2.5, 3.5, 5.0), (8e3, 20e3, 40e3, 50e3)
"""What the tables of landings and of jam times have."""
STORED_PA = DriverParameters().stored_vacuum_pa
BOTTLE_KG_ML = 0.25e-3
"""Mass of a reservoir per volume, kg/mL: a PET bottle's wall with its fitting, assumed."""


def landing_cell(height_m: float, mass_kg: float) -> str:
    """Vacuum of a landing on our robots' feet, kPa."""
    speed_m_s = math.sqrt(2.0 * STANDARD_GRAVITY_M_S2 * height_m)
    vacuum_pa = LandingModel().needed_pa(speed_m_s, mass_kg, travel_m(math.radians(RobotOptions().hang_pitch_deg)))
    if vacuum_pa > ControllerParameters().full_vacuum_pa:
        return "full"
    return f"{vacuum_pa / 1e3:.0f} kPa" if vacuum_pa else "soft"


RESERVOIRS_ML = (0, 50, 100, 250)
AIR_STEP_S = 5e-4
"""Time step of the simulated air, s."""
TROT_S, BEARING_SHARE = 0.5, QuadrupedParameters().bearing_share
"""Period of a trot at 2 Hz, s, and the share of it for which a foot stands."""
REACTION_S, TROTS = 0.1, 40
"""Since the touch-down, s, and after how many periods: the air is the same from one to the next by then."""
RATED_DUTY = DriverParameters().pump_rated_duty
TROTTING = ((6.0, RATED_DUTY), (6.0, 1.0), (9.0, RATED_DUTY), (9.0, 1.0), (12.0, 1.0))
"""Free flow of the pump, l/min, and its duty."""


def reservoir_name(volume_ml: int) -> str:
    """What the tables call a reservoir."""
    return f"{volume_ml} mL" if volume_ml else "none"


def jam_time_line(volume_ml: int) -> tuple[str, ...]:
    """How long all three channels take with a reservoir, and what it costs."""
    volume_m3 = 1e-6 * volume_ml
    air = DriverParameters(reservoir_volume_m3=volume_m3).air()
    evacuated_s = air.evacuation_s(volume_m3 and air.shared_volume_m3, STORED_PA)
    simulated = Pneumatics(PneumaticParameters(reservoir_volume_m3=volume_m3), AIR_STEP_S)
    simulated.command(1.0, (False, False, False))
    while volume_ml and STANDARD_ATMOSPHERE_PA - simulated.advance(1)[0, 0] < STORED_PA:
        pass
    vacuums_pa = connected_vacuums_pa(simulated, 1.0, 1.0)
    times = [f"{1e3 * AIR_STEP_S * (1 + np.argmax(vacuums_pa >= vacuum_pa)):.0f} ms" for vacuum_pa in TIMED_PA]
    return (reservoir_name(volume_ml), *times, f"{evacuated_s:.1f} s", f"{1e3 * BOTTLE_KG_ML * volume_ml:.0f} g")


def trot_cell(flow_l_min: float, duty: float, volume_ml: int) -> str:
    """Vacuum of a foot's channels some time after its touch-down, where all are jammed at each and the pump goes on."""
    pneumatics = PneumaticParameters(reservoir_volume_m3=1e-6 * volume_ml, pump_free_flow_l_min=flow_l_min)
    simulated = Pneumatics(pneumatics, AIR_STEP_S)
    for _ in range(TROTS):
        vacuums_pa = connected_vacuums_pa(simulated, duty, BEARING_SHARE * TROT_S)
        simulated.command(duty, (False, False, False))
        simulated.advance(round((1.0 - BEARING_SHARE) * TROT_S / AIR_STEP_S))
    return f"{vacuums_pa[round(REACTION_S / AIR_STEP_S) - 1] / 1e3:.0f} kPa"


def connected_vacuums_pa(simulated: Pneumatics, duty: float, lasts_s: float) -> NDArray[np.float64]:
    """Connect all channels for a while, and return the least vacuum of them after each step, Pa."""
    simulated.command(duty, (True, True, True))
    channels_pa = simulated.advance(round(lasts_s / AIR_STEP_S))[:, 1:]
    least_pa: NDArray[np.float64] = STANDARD_ATMOSPHERE_PA - channels_pa.max(axis=1)
    return least_pa


def workspace_text() -> str:
    """Lines that build the packages in a sourced Jazzy, with what the distribution does not have."""
    text = (ROOT / "requirements.in").read_text()
    lines = []
    for part in ("base", "view", "bags"):
        asked = re.search(rf"^# \[{part}\].*?$(.*?)(?=^# \[)", text, re.MULTILINE | re.DOTALL)
        lines += asked[1].splitlines() if asked else []
    needed = [line.split()[0] for line in lines if line and line.split()[0] not in OF_THE_DISTRIBUTION]
    return f"""```bash
python3 -m venv --system-site-packages venv && source venv/bin/activate && touch venv/COLCON_IGNORE
pip install {" ".join(needed)}
python -m colcon build --symlink-install && source install/setup.bash
ros2 launch jammkle_bringup ankle.launch.py
```"""


def pages() -> list[Path]:
    """Every page of the documentation, and the one that leads there."""
    return [ROOT / "README.md", *sorted(DOCS.glob("*.md"))]


def filled(path: Path, made: dict[str, str]) -> str:
    """Return the text of a page with every part as the code has it.

    Raises:
        ValueError: the page asks for a part that nobody makes.

    """

    def part(match: re.Match[str]) -> str:
        name = match["name"]
        if name not in made:
            msg = f"{path.name} asks for '{name}', and there is none; there are: {', '.join(made)}"
            raise ValueError(msg)
        return f"<!-- table: {name} -->\n{made[name]}\n<!-- end of table -->"

    return re.sub(r"<!-- table: (?P<name>.+?) -->\n.*?<!-- end of table -->", part, path.read_text(), flags=re.DOTALL)


def manifests() -> dict[Path, str]:
    """The manifest of every package with the project's version in it."""
    return {
        path: re.sub("<version>.*</version>", f"<version>{VERSION}</version>", path.read_text())
        for path in sorted(ROOT.glob("jammkle_*/package.xml"))
    }


def made() -> dict[Path, str]:
    """Return every file that is made from the code, whole or in part, with its text."""
    parts = tables()
    return {
        **{path: filled(path, parts) for path in pages()},
        HEADER: header_text(register_list()),
        CONFIG / "ankle.yaml": parameter_file_text(NODES_OF_AN_ANKLE, {}),
        CONFIG / "robot.yaml": parameter_file_text(ROBOT_NODES, ROBOT_VALUES),
        **manifests(),
    }


def parameter_file_text(nodes: Sequence[NodeEntry], values: dict[str, dict[str, object]]) -> str:
    """Parameter file with every parameter of the nodes, described: its default, or what `values` has, by node."""
    lines = [
        "# Every parameter with its default, made from the nodes' tables. Copy it, keep what you change,",
        "# and give it to the graph: jammkle up --params FILE",
    ]
    for entry in nodes:
        lines += ["", f"/**/{entry.name}:", "  ros__parameters:"]
        for row in rows(entry.parameters()):
            about = row.description if not row.unit else f"{row.description} [{row.unit}]"
            lines += COMMENT.wrap(about + (f" ({row.range_text})" if row.range_text else ""))
            # PyYAML writes a float so that YAML 1.1 reads one: 6.0e-06, for 6e-06 would be text.
            value = yaml.safe_dump(values.get(entry.name, {}).get(row.name, row.default), default_flow_style=True)
            lines.append(f"    {row.name}: {value.splitlines()[0]}")
    return "\n".join(lines) + "\n"


def header_text(registers: RegisterList) -> str:
    """Return `firmware/core/registers.h`."""
    holding = registers.tables["holding_registers"]
    stored = [register.address for register in holding if register.stored]
    assert stored == list(range(stored[0], stored[-1] + 1)), "the firmware keeps stored registers as one block"
    lines = [
        "/* Written from config/registers.yaml by `make readme`: edit that file. */",
        "#ifndef JAMMKLE_REGISTERS_H",
        "#define JAMMKLE_REGISTERS_H",
        "",
        "#include <stdbool.h>",
        "#include <stdint.h>",
        "",
        f"#define FIRMWARE_VERSION {registers.firmware_version:#06x}u",
        f"#define REGISTER_VERSION {registers.version}u",
        f"#define MIRROR_ADDRESS {registers.mirror}u",
        "",
    ]
    for name, found in registers.tables.items():
        prefix = name.partition("_")[0].removesuffix("s").upper()
        members = [f"    {prefix}_{register.name.upper()}," for register in found]
        lines += ["enum {", *members, f"    {prefix}_COUNT", "};", ""]
    for name, bits in registers.bits.items():
        places = [f"    {name.upper()}_{bit.upper()} = {1 << place}," for place, bit in enumerate(bits)]
        lines += ["enum {", *places, "};", ""]
    ranges = [f"    {{{each.minimum}u, {each.maximum}u, {each.default}u}}, /* {each.name} */" for each in holding]
    lines += [
        "typedef struct {",
        "    uint16_t minimum;",
        "    uint16_t maximum;",
        "    uint16_t default_value;",
        "} holding_range;",
        "",
        "static const holding_range HOLDING_RANGES[HOLDING_COUNT] = {",
        *ranges,
        "};",
        "",
        f"#define STORED_FIRST {stored[0]}u",
        f"#define STORED_COUNT {len(stored)}u",
        "",
        "#endif",
        "",
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    for target, content in made().items():
        target.write_text(content)
