"""`jammkle demo`: land the simulated ankle on a slope, record it, say what happened and what was wrong with it."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from jammkle_bringup.core.landing import read_run, summary_of
from jammkle_bringup.core.supervisor import Supervisor
from jammkle_bringup.graph_client import LOOKERS, GraphClient, refuse_if_doubled
from jammkle_bringup.graph_options import GraphOptions, makes_clock, node_names
from jammkle_bringup.up import Startup, beside_others, child_specs, say_how_it_ended, steering
from jammkle_common.command.errors import GraphError, InputError
from jammkle_common.command.results import say
from jammkle_common.names import CHANNELS, CONTACT_EVENTS, JAM_STATE, SIM_NODE
from jammkle_common.qos import subscriber_qos
from jammkle_msgs.msg import ChannelJamState, ContactEvent, JamState
from jammkle_sim.parameters import SimParameters

if TYPE_CHECKING:
    import datetime as dt
    from collections.abc import Callable
    from typing import TextIO

    from jammkle_bringup.core.landing import RunSummary
    from jammkle_bringup.core.node_table import ParameterValue
    from jammkle_bringup.core.supervisor import Death
    from jammkle_gap import HiddenEffect

LANDING_TIMEOUT_S = 8.0
"""Simulated time, s, until the impact was felt, everything is jammed and the body is at rest. It falls at 1 s, and is
at rest after 2 s as a rule."""

_AFTER_JAMMED_S = 0.5
"""Simulated time that is recorded after that, s."""
_PA_PER_KPA = 1e3
_CHUNK_S = 0.25
"""Simulated time, s, after which it is looked again whether all that has come."""


@dataclass(frozen=True)
class DemoResult:
    """What a demo left behind."""

    summary: RunSummary
    picture: Path
    page: Path
    """Of the gap, `gap.html`."""
    ending: Any
    """The diagnosis of the ankle, and what was true; see `HiddenEffect`."""
    exit_code: int


@dataclass
class _Seen:
    events: list[int] = field(default_factory=list)
    jammed: frozenset[str] = frozenset()

    def on_event(self, event: ContactEvent) -> None:
        self.events.append(event.type)

    def on_state(self, state: JamState) -> None:
        self.jammed = frozenset(each.channel for each in state.channels if each.state == ChannelJamState.JAMMED)


def demo(
    make_folder: Callable[[], Path], namespace: str, hidden: HiddenEffect, asked_to_stop: Callable[[], bool]
) -> DemoResult:
    """Run the demo in a normalised namespace, with something hidden in the ankle that the diagnosis does not know.

    The run's folder is made once it is known that the demo can start.

    Raises:
        InputError: a graph is already up in the namespace, or the folder cannot be made.
        GraphError: the graph did not start, or a node died.
        Interrupted: the command was asked to stop; everything was stopped in order.

    """
    say("a simulated ankle is dropped onto a slope of 40 degrees, recorded, and diagnosed; this takes half a minute")
    with tempfile.TemporaryDirectory() as scratch:
        options = _options(namespace, hidden.effects_file, Path(scratch), asked_to_stop)
        folder = make_folder()
        bag = folder / "bag"
        with (folder / "graph.log").open("w", encoding="utf-8") as log:
            bad = land(replace(options, bag=bag), log, asked_to_stop)
    if say_how_it_ended(None, bad):
        msg = f"the graph did not stop well; its output is in {folder / 'graph.log'}"
        raise GraphError(msg)
    run = read_run(bag, namespace)
    summary = summary_of(run, str(bag))
    picture = folder / "run.png"
    from jammkle_bringup.core.picture import draw  # noqa: PLC0415 - half a second that only the end of the demo needs

    draw(run, summary, picture)
    exit_code = say_verdict(summary)
    ending = hidden.diagnosed(bag, namespace, asked_to_stop)
    return DemoResult(summary, picture, ending.write_page(folder), ending, exit_code)


def say_verdict(summary: RunSummary) -> int:
    """Say what a landing should have had and had not; return the exit code."""
    failures = []
    if summary.detected_s is None:
        failures.append("the impact was not detected")
    failures += [
        f"{channel.channel} did not reach its vacuum" for channel in summary.channels if channel.reached_s is None
    ]
    if failures:
        say(f"the landing failed: {'; '.join(failures)}")
    return 1 if failures else 0


def land(options: GraphOptions, log: TextIO, asked_to_stop: Callable[[], bool]) -> tuple[Death, ...]:
    """Run the graph through one landing and stop it; return what did not end well.

    It takes longer than discovery, so that another graph which was not seen before is seen in its end.

    Raises:
        InputError: there is one.
        GraphError: the graph did not start, or a node died.
        Interrupted: asked to stop.

    """

    def keep(name: str, line: str) -> None:
        log.write(f"[{name}] {line}\n")

    screen = Console(stderr=True)
    specs = child_specs(options)
    with Supervisor(specs, keep) as supervisor:
        with (
            GraphClient(options.namespace, asked_to_stop, LOOKERS) as client,
            screen.status("starting the graph") as progress,
        ):
            seen = _Seen()
            client.subscribe(ContactEvent, CONTACT_EVENTS, seen.on_event, subscriber_qos(CONTACT_EVENTS))
            client.subscribe(JamState, JAM_STATE, seen.on_state, subscriber_qos(JAM_STATE))
            startup = Startup(client, supervisor, f"; the output is in {log.name}")
            startup.wait_until_connected([spec.name for spec in specs])
            startup.wait_until_active()
            startup.wait_until_in_step(steering(options, [spec.name for spec in specs]))
            supervisor.loaded()
            refuse_if_doubled(client, node_names(options), makes_clock=makes_clock(options))
            say("simulation, controller, driver and recorder are there")
            _land(startup.step if makes_clock(options) else startup.wait_steps, seen, progress.update)
            refuse_if_doubled(client, node_names(options), makes_clock=makes_clock(options))
            progress.update("stopping")
        return supervisor.stop()


def _options(namespace: str, effects: str, scratch: Path, asked_to_stop: Callable[[], bool]) -> GraphOptions:
    """Return the options of a graph that stands paused, beside others; the content of an effects file goes to a folder.

    Raises:
        InputError: a graph is already up.

    """
    values: dict[str, ParameterValue] = {"start_paused": True}
    if effects:
        file = scratch / "effects.yaml"
        file.write_text(effects, encoding="utf-8")
        values["effects_file"] = str(file)
    return beside_others(GraphOptions(namespace, values={SIM_NODE: values}), asked_to_stop)


def _land(advance: Callable[[int], object], seen: _Seen, show: Callable[[str], None]) -> None:
    """Take simulated time on until the impact was felt, all is jammed and the body is at rest, as far as that comes.

    The simulation goes from one look to the next and waits there, so that a landing ends at the same simulated time on
    every machine.
    """
    steps = round(_CHUNK_S / SimParameters().timestep_s)
    end_s, said = LANDING_TIMEOUT_S, set[str]()
    time_s = 0.0
    while time_s < end_s:
        time_s += _CHUNK_S
        advance(steps)
        show(f"landing: {time_s:.2f} s of simulated time")
        jammed = seen.jammed == frozenset(CHANNELS)
        for text, holds in (
            ("impact detected", ContactEvent.IMPACT in seen.events),
            ("all channels are jammed", jammed),
        ):
            if holds and text not in said:
                said.add(text)
                say(text)
        if jammed and ContactEvent.SETTLED in seen.events and end_s == LANDING_TIMEOUT_S:
            end_s = time_s + _AFTER_JAMMED_S


def fresh_folder(parent: Path, day: dt.date) -> Path:
    """Make and return `parent/<date>-<n>` with the first n from 1 on that is free.

    Raises:
        InputError: it cannot be made.

    """
    number = 1
    while True:
        folder = parent / f"{day.isoformat()}-{number}"
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            number += 1
        except OSError as error:
            msg = f"folder {folder} cannot be made: {error.strerror}"
            raise InputError(msg) from error
        else:
            return folder


def summary_table(summary: RunSummary) -> Table:
    """Return the short table of a landing."""
    table = Table(title="Landing", title_justify="left", show_header=False)
    table.add_column("what")
    table.add_column("value")
    table.add_row("touch-down", _seconds(summary.touch_down_s))
    table.add_row("impact detected", f"{_seconds(summary.detected_s)}{_after(summary.detected_s, summary)}")
    for channel in summary.channels:
        if channel.reached_s is None or channel.commanded_vacuum_pa is None:
            greatest = "" if channel.greatest_vacuum_pa is None else f" (at most {_pa(channel.greatest_vacuum_pa)})"
            table.add_row(channel.channel, f"did not reach its vacuum{greatest}")
            continue
        reached = f"{_pa(channel.commanded_vacuum_pa)} at {_seconds(channel.reached_s)}"
        table.add_row(channel.channel, f"{reached}{_after(channel.reached_s, summary)}")
    peak = summary.peak_deceleration_m_s2
    table.add_row("peak deceleration", "not known" if peak is None else f"{peak:.2f} m/s² (IMU z minus g)")
    table.add_row("bag", escape(summary.bag))
    return table


def _after(time_s: float | None, summary: RunSummary) -> str:
    if time_s is None or summary.touch_down_s is None:
        return ""
    late_ms = round((time_s - summary.touch_down_s) * 1e3, 1) + 0.0  # no -0.0
    return f", {late_ms:+.1f} ms from touch-down"


def _seconds(time_s: float | None) -> str:
    return "not seen" if time_s is None else f"{time_s:.3f} s"


def _pa(pascal: float) -> str:
    return f"{pascal / _PA_PER_KPA:.1f} kPa"
