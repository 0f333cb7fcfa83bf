"""Arguments of `jammkle detect`."""

# ruff: noqa: PLC0415 - imported where needed: `jammkle --help` shall not wait for NumPy and Matplotlib

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from jammkle_common.command.options import ON_BAGS, JsonOption

app = typer.Typer(context_settings={"help_option_names": ["-h", "--help"]})

_TABLE = "Tables (.csv, .txt, .tsv)"


@app.command(rich_help_panel=ON_BAGS)
def detect(  # noqa: PLR0913, PLR0917 - the options of a command line
    recording: Annotated[Path, typer.Argument(help="A bag with an IMU, or a table.", metavar="RECORDING")],
    output: Annotated[
        Path, typer.Option("-o", "--output", help="Folder of events.json and detect.png.", metavar="DIR")
    ] = Path("runs/detect"),
    mount: Annotated[str, typer.Option(help="Where the IMU is: foot, shank or body.")] = "body",
    settings: Annotated[
        list[str] | None, typer.Option("--set", help="NAME=VALUE of a parameter of the controller; may be repeated.")
    ] = None,
    topic: Annotated[
        str, typer.Option(help="Topic of the IMU in a bag.", show_default="imu/data, or the only IMU")
    ] = "",
    namespace: Annotated[str | None, typer.Option(help="Namespace of the ankle, if the bag holds several.")] = None,
    force: Annotated[
        str, typer.Option(help="Columns of the specific force, names or numbers from 1.", rich_help_panel=_TABLE)
    ] = "1,2,3",
    rate: Annotated[
        str, typer.Option(help="Columns of the angular velocity; empty: no gyro.", rich_help_panel=_TABLE)
    ] = "4,5,6",
    time: Annotated[str, typer.Option(help="Column of the time, s.", rich_help_panel=_TABLE)] = "",
    contact_force: Annotated[
        str, typer.Option(help="Column of a force or switch, drawn beside and not used.", rich_help_panel=_TABLE)
    ] = "",
    force_unit: Annotated[str, typer.Option(help="m/s^2 or g; of a bag, too.", rich_help_panel=_TABLE)] = "m/s^2",
    rate_unit: Annotated[str, typer.Option(help="rad/s or deg/s; of a bag, too.", rich_help_panel=_TABLE)] = "rad/s",
    rate_hz: Annotated[float, typer.Option(help="Rate of the rows, without --time.", rich_help_panel=_TABLE)] = 0.0,
    json: JsonOption = None,
) -> int:
    """Run detectors and policy over any recording with an IMU, and write its events and a picture."""
    from jammkle_common.names import normalised
    from jammkle_controller.detect import detect as run
    from jammkle_controller.recordings import TableFormat

    layout = TableFormat(
        force=_listed(force),
        rate=_listed(rate),
        time=time,
        reference=contact_force,
        force_unit=force_unit,
        rate_unit=rate_unit,
        rate_hz=rate_hz,
    )
    changed = (f"imu_mount={mount}", *(settings or ()))
    place = None if namespace is None else normalised(namespace)
    return run(recording, changed, layout, topic=topic, namespace=place, output=output, json=json)


def _listed(text: str) -> tuple[str, ...]:
    return tuple(part.strip() for part in text.split(",") if part.strip())
