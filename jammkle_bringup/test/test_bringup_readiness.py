"""Waiting for a graph that starts: what is missing is named, a death ends the wait, and so does a request to stop."""

from __future__ import annotations

import sys
import time
from typing import TYPE_CHECKING

import pytest

from jammkle_bringup import up
from jammkle_bringup.core.supervisor import ChildSpec, Supervisor
from jammkle_bringup.graph_client import GraphClient
from jammkle_bringup.up import Startup
from jammkle_common.command.errors import GraphError, Interrupted
from jammkle_common.names import CONTROLLER_NODE, DRIVER_NODE, IMU, SIM_NODE

if TYPE_CHECKING:
    from collections.abc import Callable

SLEEPING = ChildSpec("sim", (sys.executable, "-c", "import time; time.sleep(600)"))
DYING = ChildSpec("sim", (sys.executable, "-c", "import sys; sys.exit('no more air')"))


def wait(spec: ChildSpec, asked_to_stop: Callable[[], bool] = lambda: False) -> None:
    """Wait for a graph whose only process is not a node at all."""
    with (
        Supervisor([spec], lambda *_: None) as supervisor,
        GraphClient("/", asked_to_stop) as client,
    ):
        Startup(client, supervisor, "; see the log").wait_until_connected({SIM_NODE, CONTROLLER_NODE})


@pytest.mark.usefixtures("ros_domain")
def test_what_is_missing_is_named_when_the_time_is_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """The line names nodes, topics and the time, speaks only of nodes that were started, and ends with the hint."""
    monkeypatch.setattr(up, "READY_TIMEOUT_S", 0.3)
    with pytest.raises(GraphError, match=r"not ready after 0\.3 s, missing: .*; see the log$") as caught:
        wait(SLEEPING)
    assert f"{SIM_NODE} ({IMU.name})" in str(caught.value)
    assert f"{CONTROLLER_NODE} ({IMU.name})" in str(caught.value)
    assert DRIVER_NODE not in str(caught.value)


@pytest.mark.usefixtures("ros_domain")
def test_a_death_ends_the_wait() -> None:
    """Who died is said, long before the time is up."""
    with pytest.raises(GraphError, match="sim died with exit code 1; it said: no more air; see the log"):
        wait(DYING)


@pytest.mark.usefixtures("ros_domain")
def test_a_driver_that_could_not_be_configured_is_not_waited_for() -> None:
    """It answers, and is not active: nothing more will come of it."""
    idle = ChildSpec("driver", (sys.executable, "-m", "jammkle_driver", "--ros-args", "-p", "autostart:=false"))
    with Supervisor([idle], lambda *_: None) as supervisor, GraphClient("/", lambda: False) as client:
        startup = Startup(client, supervisor)
        with pytest.raises(GraphError, match=r"driver is not active \(lifecycle state 1\)"):
            startup.wait_until_active()


@pytest.mark.usefixtures("ros_domain")
def test_a_request_to_stop_ends_the_wait() -> None:
    """Ctrl-C need not wait for nodes that never come."""
    end_s = time.monotonic() + 0.3
    with pytest.raises(Interrupted):
        wait(SLEEPING, lambda: time.monotonic() > end_s)
