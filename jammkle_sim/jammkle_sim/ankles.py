"""All ankles of the sim node: what each publishes, what commands it, and how each is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from jammkle_sim.core.schedule import Output
from jammkle_sim.health import command_health, tendon_health
from jammkle_sim.inputs import AnkleHardware, Commands
from jammkle_sim.outputs import AnkleSensors, Outputs

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping

    from rclpy.node import Node

    from jammkle_common.diagnostics import Health
    from jammkle_sim.core.engine import Tick

RIG_OUTPUTS = tuple(output for output in Output if output not in (Output.TRUE_CONTACT, Output.GAIT))
"""What a rig's ankle has: no truth of its foot, and no gait."""
ROBOT_OUTPUTS = tuple(output for output in Output if output is not Output.LOAD_CELL)
"""What a robot's ankle has: no load cell."""


class Ankle(AnkleSensors, AnkleHardware, Protocol):
    """One simulated ankle: what obeys, and what is published."""


@dataclass(frozen=True)
class _OnGraph:
    """One ankle on the graph."""

    name: str
    outputs: Outputs
    commands: Commands


class Ankles:
    """Publishers and subscriptions of one ankle in the node's own namespace, or of several below it."""

    def __init__(
        self,
        node: Node,
        ankles: Mapping[str, Ankle],
        outputs: Collection[Output],
        on_change: Callable[[], None],
        time_s: Callable[[], float],
    ) -> None:
        """Put the ankles on the graph.

        Args:
            node: The sim node.
            ankles: By namespace below the node's own; a single one under an empty name is in that.
            outputs: What each of them can publish.
            on_change: Called when the health of one has become something else.
            time_s: Gives simulated time, s.

        """
        self._on_change = on_change
        self._all = [
            _OnGraph(name, Outputs(node, ankle, outputs, name), Commands(node, ankle, on_change, time_s, name))
            for name, ankle in ankles.items()
        ]
        self._reported_broken: list[tuple[str, ...]] = []

    @property
    def heard(self) -> int:
        """How many messages of the drivers have come."""
        return sum(each.commands.heard for each in self._all)

    def show(self, ankles: Mapping[str, AnkleSensors]) -> None:
        """Sample these from now on, by the names of the start."""
        for each in self._all:
            each.outputs.show(ankles[each.name])

    def publish(self, tick: Tick) -> None:
        """Publish a tick's outputs of every ankle.

        Raises:
            NotFiniteError: the simulation gave NaN or infinity; it was not published.

        """
        for each in self._all:
            each.outputs.publish(tick)

    def acknowledge(self, time_ns: int) -> None:
        """Say what has changed of the commands; to be called before each step, at its simulated time, ns."""
        for each in self._all:
            each.commands.acknowledge(time_ns)

    def set_paused(self, time_ns: int, *, paused: bool) -> None:
        """Say whether the ankles stand still although the clock may go on; simulated time of now, ns."""
        for each in self._all:
            each.commands.set_paused(time_ns, paused=paused)

    def begin(self) -> None:
        """Say what is commanded before the first step, with the next acknowledgement."""
        for each in self._all:
            each.commands.begin()

    def look_for_silence(self) -> None:
        """Let go of ankles whose driver has been silent for too long; to be called before each step."""
        for each in self._all:
            each.commands.look_for_silence()

    def repeat(self, time_ns: int) -> None:
        """Say it once more where nothing was said since the last call."""
        for each in self._all:
            each.commands.repeat(time_ns)

    def apply(self) -> None:
        """Command again what stands: a reset robot is still wired to the same drivers."""
        for each in self._all:
            each.commands.apply()

    def tell_breaks(self) -> None:
        """Say at once that a tendon broke."""
        broken = [each.outputs.broken_tendons for each in self._all]
        if broken != self._reported_broken:
            self._reported_broken = broken
            self._on_change()

    def health(self) -> list[Health]:
        """Return two lines for each: its tendons, its commands."""
        return [
            line
            for each in self._all
            for line in (
                tendon_health(each.outputs.broken_tendons, each.name),
                command_health(each.commands.refused, each.name, let_go=each.commands.let_go),
            )
        ]
