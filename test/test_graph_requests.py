"""What is asked of a running graph and refused, or only looked at: it goes on as if nothing had happened."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest

from graph import Probe, Up, shared_graph
from jammkle_common.names import CHANNELS, DIAGNOSTICS, JAM, JAM_STATE, STEP, UNJAM

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

GOOD_VACUUM_PA = 50e3
STATUS_CALLS = 6
"""As many as it once took to miss a node."""


@pytest.fixture(scope="module")
def graph(tmp_path_factory: pytest.TempPathFactory, left_alone: tuple[str, str]) -> Iterator[tuple[Up, Probe]]:
    """Bring up one ankle that the controller leaves alone, with a node that looks on."""
    with shared_graph(tmp_path_factory.mktemp("requests"), "up", *left_alone) as (up, probe):
        yield up, probe


@pytest.fixture
def begin(graph: tuple[Up, Probe], tmp_path: Path) -> Callable[..., Up]:
    """Start `jammkle` with arguments beside that graph."""
    started = 0

    def start(*arguments: str) -> Up:
        nonlocal started
        folder = tmp_path / f"process_{started}"
        folder.mkdir()
        started += 1
        return Up(graph[1].context.get_domain_id(), folder, *arguments)

    return start


def test_status_lists_every_node_every_time(graph: tuple[Up, Probe], begin: Callable[..., Up], tmp_path: Path) -> None:
    """Each call is a process that has to discover the graph anew, and shows every line of every node."""
    _, probe = graph
    probe.listen(DIAGNOSTICS)
    probe.spin_until(lambda: len({node_of(line) for line in lines_of(probe)}) == 3, "every node reports")
    reported = {line for line in lines_of(probe) if "nodes" not in line}
    files = [tmp_path / f"{number}.json" for number in range(STATUS_CALLS)]
    for call in [begin("status", "--json", str(file)) for file in files]:
        assert call.wait() == 0
    for file in files:
        listed = {line["name"] for line in json.loads(file.read_text())["health"]}
        assert {node_of(line) for line in listed} == {"/controller", "/driver", "/sim"}
        assert reported <= listed


def lines_of(probe: Probe) -> set[str]:
    """Names of the lines on /diagnostics so far, `/node: about`."""
    return {status.name for message in probe.received[DIAGNOSTICS.name] for status in message.status}


def node_of(line: str) -> str:
    """Node that a line on /diagnostics is of."""
    return line.split(":", maxsplit=1)[0]


def test_a_second_up_in_the_namespace_is_refused(graph: tuple[Up, Probe], begin: Callable[..., Up]) -> None:
    """One clear line and exit code 2; the first graph goes on as if nothing had happened."""
    up, probe = graph
    second = begin("up")
    assert second.wait() == 2
    assert "already up" in second.text().strip().splitlines()[-1]
    assert "Traceback" not in second.text()
    assert up.process.poll() is None
    assert probe.call(JAM).success
    assert probe.call(UNJAM).success
    probe.spin_until(lambda: not commanded(probe), "all is released again")


@pytest.mark.parametrize(
    ("request_fields", "words"),
    [
        ({"channels": ["soleus"]}, ("soleus", *CHANNELS)),
        ({"vacuum_pa": float("nan")}, ("nan",)),
        ({"vacuum_pa": float("inf")}, ("inf",)),
        ({"vacuum_pa": 1e6}, ("1e+06", "Pa")),
        ({"vacuum_pa": -5e3}, ("-5",)),
        ({"channels": ["achilles", "soleus"], "vacuum_pa": GOOD_VACUUM_PA}, ("soleus",)),
    ],
)
def test_a_bad_jam_request_changes_nothing(
    graph: tuple[Up, Probe], request_fields: dict[str, object], words: tuple[str, ...]
) -> None:
    """The answer is success=false with the value and the limit in it, and no channel is commanded."""
    _, probe = graph
    answer = probe.call(JAM, **request_fields)
    assert not answer.success
    assert all(word in answer.message for word in words), answer.message
    assert "\n" not in answer.message
    assert not commanded(probe)


def test_a_step_is_refused_while_running(graph: tuple[Up, Probe]) -> None:
    """Stepping needs a pause first; the answer says so."""
    _, probe = graph
    answer = probe.call(STEP, steps=10)
    assert not answer.success
    assert "pause" in answer.message.lower()


def test_a_vacuum_beyond_the_limit_is_bad_input(graph: tuple[Up, Probe], begin: Callable[..., Up]) -> None:
    """`jammkle jam` with a vacuum that the running driver does not allow: exit code 2 and one line with the limit."""
    _, probe = graph
    process = begin("jam", "--vacuum-kpa", "900")
    assert process.wait() == 2
    lines = process.text().strip().splitlines()
    assert len(lines) == 1
    assert "900" in lines[0]
    assert not commanded(probe)


def test_a_service_is_called_from_the_shell(graph: tuple[Up, Probe], begin: Callable[..., Up], tmp_path: Path) -> None:
    """What nodes name as the way out can be typed: with a value where it takes one; a bad call is refused at once."""
    _, probe = graph
    assert begin("call", "driver/achilles/jam", "true").wait() == 0
    assert commanded(probe)
    answer = tmp_path / "answer.json"
    for words in (["driver/unjam_all", "--json", str(answer)], ["/driver/clear_fault"]):
        process = begin("call", *words)
        assert process.wait() == 0, process.text()
    assert json.loads(answer.read_text())["success"]
    assert not commanded(probe)
    for words, said in (
        (["driver/soleus/jam", "true"], "is not one of"),
        (["controller/set_auto"], "takes true or false"),
        (["driver/clear_fault", "true"], "takes no value"),
    ):
        refused = begin("call", *words)
        assert refused.wait() == 2
        assert said in refused.text()


def commanded(probe: Probe) -> bool:
    """Whether the driver says from now on that a vacuum is commanded."""
    before = len(probe.received[JAM_STATE.name])
    probe.spin_until(lambda: len(probe.received[JAM_STATE.name]) > before, "the driver tells its state")
    return any(channel.commanded_vacuum_pa > 0.0 for channel in probe.last(JAM_STATE).channels)
