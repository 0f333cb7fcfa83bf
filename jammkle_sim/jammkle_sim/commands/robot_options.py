"""Options of `jammkle robot` from the robots' own table of options: names, types, defaults, ranges, help."""

from __future__ import annotations

import inspect
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from jammkle_common.command.errors import InputError
from jammkle_common.command.options import JsonOption, NamespaceOption
from jammkle_common.parameters import ParameterError, ParameterRow, as_typed, from_mapping, in_si, rows, typed_row
from jammkle_sim.robots.options import ROBOTS, RobotOptions

if TYPE_CHECKING:
    from collections.abc import Callable


@dataclass(frozen=True)
class RobotRequest:
    """One call of `jammkle robot`."""

    robot: str
    options: RobotOptions
    bag: Path
    duration_s: float
    imu_rate_hz: int
    vacuum_pa: float
    namespace: str
    json: Path | None


_COMMON: dict[str, tuple[Any, Any]] = {
    "robot": (Annotated[str, typer.Argument(help=f"{' or '.join(ROBOTS)}.", metavar="ROBOT")], inspect.Parameter.empty),
    "output": (
        Annotated[Path, typer.Option("-o", "--output", help="Folder of the new bag.", metavar="DIR")],
        inspect.Parameter.empty,
    ),
    "duration_s": (Annotated[float, typer.Option(help="Simulated time, 0.1 to 3600 s.")], 5.0),
    "imu_rate_hz": (
        Annotated[int, typer.Option(help="Rate of IMU, joints, tendons and true contact: 100, 200, 500 or 1000 Hz.")],
        500,
    ),
    "vacuum_kpa": (
        Annotated[float, typer.Option(help="Vacuum of all ankles from the start on, 0 to 75 kPa; 0: soft.")],
        0.0,
    ),
    "namespace": (NamespaceOption, "/"),
    "json": (JsonOption, None),
}
_LONGEST_S, _SHORTEST_S = 3600.0, 0.1
_RATES_HZ = (100, 200, 500, 1000)
_LARGEST_VACUUM_KPA = 75.0


def robot_command(run: Callable[[RobotRequest], int]) -> Callable[..., int]:
    """Return the verb, whose signature typer turns into options; `run` gets what was asked for."""
    typed = {row.name: typed_row(row) for row in rows(RobotOptions)}
    own = {
        row.name: (Annotated[type(row.default), typer.Option(help=_help(row))], row.default) for row in typed.values()
    }
    parameters = {**_COMMON, **own}

    def robot(**values: Any) -> int:
        """Run a leg or a quadruped without the graph, as fast as it can, and write a bag with the true contacts."""
        _check(values)
        try:
            options = from_mapping(RobotOptions, {name: in_si(name, values[row.name]) for name, row in typed.items()})
        except ParameterError as error:
            raise InputError(as_typed(error)) from error
        return run(
            RobotRequest(
                robot=values["robot"],
                options=options,
                bag=values["output"],
                duration_s=values["duration_s"],
                imu_rate_hz=values["imu_rate_hz"],
                vacuum_pa=float(in_si("vacuum_pa", values["vacuum_kpa"])),
                namespace=values["namespace"],
                json=values["json"],
            )
        )

    robot.__signature__ = inspect.Signature(  # type: ignore[attr-defined]  # typer asks inspect, which knows it
        [
            inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation)
            for name, (annotation, default) in parameters.items()
        ]
    )
    robot.__annotations__ = {name: annotation for name, (annotation, _) in parameters.items()}
    return robot


def _check(values: dict[str, Any]) -> None:
    """Refuse what is no robot's own option and out of range."""
    if values["robot"] not in ROBOTS:
        msg = f"ROBOT '{values['robot']}' does not exist; it must be {' or '.join(ROBOTS)}"
        raise InputError(msg)
    if not _SHORTEST_S <= values["duration_s"] <= _LONGEST_S:
        msg = f"--duration-s {values['duration_s']:g} must be {_SHORTEST_S:g} to {_LONGEST_S:g} s"
        raise InputError(msg)
    if values["imu_rate_hz"] not in _RATES_HZ:
        msg = f"--imu-rate-hz {values['imu_rate_hz']} must be one of {', '.join(map(str, _RATES_HZ))} Hz"
        raise InputError(msg)
    if not 0.0 <= values["vacuum_kpa"] <= _LARGEST_VACUUM_KPA:
        msg = f"--vacuum-kpa {values['vacuum_kpa']:g} must be 0 to {_LARGEST_VACUUM_KPA:g} kPa"
        raise InputError(msg)


def _help(row: ParameterRow) -> str:
    return f"{row.description}. {row.range_text or row.unit}".rstrip(". ") + "."
