"""Whom a simulation waits for: answers, silence, and every kind of wrong answer."""

from __future__ import annotations

import pytest

from jammkle_common.messages import Level
from jammkle_sim.core.lockstep import MOST_PAST_ANSWERS, REPEAT_S, Lockstep


class Steps:
    """An account of ticks and answers, with a clock that the test sets."""

    def __init__(self, timeout_s: float = 1.0) -> None:
        self.now_s = 100.0
        self.account = Lockstep(timeout_s, lambda: self.now_s)

    def joined(self, *names: str) -> Steps:
        self.account.sent(1000)
        for name in names:
            self.account.answered(name, 1000)
        return self

    def said(self) -> tuple[Level, str]:
        health = self.account.health()
        return health.level, health.message


def test_nobody_is_waited_for_before_it_has_answered_once() -> None:
    """A simulation without participants runs freely."""
    steps = Steps()
    assert steps.account.ready()
    steps.account.sent(1000)
    assert steps.account.ready()
    assert steps.said() == (Level.OK, "nobody takes part")


def test_the_next_step_waits_for_every_answer() -> None:
    """All who have joined must answer each tick, in whatever order."""
    steps = Steps().joined("/driver", "/controller")
    assert steps.account.ready()
    steps.account.sent(2000)
    assert not steps.account.ready()
    steps.account.answered("/controller", 2000)
    assert not steps.account.ready()
    assert steps.account.missing == ("/driver",)
    steps.account.answered("/driver", 2000)
    assert steps.account.ready()
    assert steps.said() == (Level.OK, "in step: /controller, /driver")


def test_a_silent_one_is_named_and_given_up_until_it_answers_again() -> None:
    """A killed node stops nothing for longer than the time-out; one that comes back is waited for again."""
    steps = Steps(timeout_s=1.0).joined("/driver", "/controller")
    steps.account.sent(2000)
    steps.account.answered("/controller", 2000)
    steps.now_s += 0.9
    assert not steps.account.ready()
    steps.now_s += 0.2
    assert steps.account.ready()
    level, message = steps.said()
    assert level is Level.WARN
    assert message.startswith("/driver has not answered for 1 s")
    steps.account.sent(3000)
    steps.account.answered("/controller", 3000)
    assert steps.account.ready()
    steps.account.answered("/driver", 3000)
    steps.account.sent(4000)
    assert steps.account.missing == ("/controller", "/driver")


def test_without_a_timeout_a_debugger_may_take_for_ever() -> None:
    """With a time-out of 0 time stands still, and who it stands still for is named."""
    steps = Steps(timeout_s=0.0).joined("/driver")
    steps.account.sent(2000)
    steps.now_s += 1e5
    assert not steps.account.ready()
    assert steps.said() == (Level.WARN, "time stands still until /driver answers (lockstep_timeout_s is 0)")


@pytest.mark.parametrize("timeout_s", [0.0, 1.0])
def test_an_answer_from_the_future_is_no_answer_and_no_standstill(timeout_s: float) -> None:
    """A stamp that was never sent is reported, and its sender is not waited for until it gives a right one."""
    steps = Steps(timeout_s).joined("/driver")
    steps.account.sent(2000)
    steps.account.answered("/driver", 5_000_000_000)
    assert steps.account.ready()
    steps.now_s += 2.0 * REPEAT_S
    assert "/driver says it is done with 5.0000 s, which is to come" in steps.said()[1]
    steps.account.answered("/driver", 2000)
    assert steps.said()[0] is Level.OK
    steps.account.sent(3000)
    assert not steps.account.ready()


def test_an_answer_may_come_before_its_tick_does() -> None:
    """Where another simulation makes the ticks a participant may have had one first: it counts once that is here."""
    steps = Steps().joined("/driver")
    steps.account.answered("/driver", 2000)
    assert steps.said()[0] is Level.OK
    steps.account.sent(2000)
    assert steps.account.participants == ("/driver",)
    assert steps.account.ready()
    steps.account.sent(3000)
    assert steps.account.missing == ("/driver",)


@pytest.mark.parametrize("timeout_s", [0.0, 1.0])
def test_who_lives_in_the_past_is_given_up_and_who_is_late_is_not(timeout_s: float) -> None:
    """One old answer is a slow node's; always old ones are of a node in another time."""
    steps = Steps(timeout_s).joined("/slow", "/stuck")
    steps.account.sent(2000)
    steps.account.answered("/slow", 1000)
    for _ in range(MOST_PAST_ANSWERS + 1):
        steps.account.answered("/stuck", 1000)
    assert steps.account.missing == ("/slow",)
    assert "/stuck keeps saying that it is done with 0.0000 s" in steps.said()[1]
    steps.account.answered("/slow", 2000)
    assert steps.account.ready()


def test_two_nodes_of_one_name_are_noticed() -> None:
    """More answers than ticks are of two nodes: either may not be done yet when the other has answered."""
    steps = Steps().joined("/driver")
    steps.account.sent(2000)
    steps.account.answered("/driver", 2000)
    steps.account.sent(2000)  # a tick that is repeated is answered again
    steps.account.answered("/driver", 2000)
    assert steps.said()[0] is Level.OK
    steps.account.answered("/driver", 2000)
    assert steps.said() == (Level.WARN, "/driver answers twice: two nodes have that name")


def test_who_leaves_is_waited_for_no_more() -> None:
    """A node that is stopped in order costs no time-out."""
    steps = Steps().joined("/driver", "/guest")
    steps.account.sent(2000)
    steps.account.answered("/driver", 2000)
    steps.account.forget("/guest")
    assert steps.account.ready()
    assert steps.said() == (Level.OK, "in step: /driver")


def test_time_that_is_set_back_asks_everybody_again() -> None:
    """Answers of before do not count for stamps that come a second time."""
    steps = Steps().joined("/driver")
    steps.account.sent(500)
    assert not steps.account.ready()
    steps.account.answered("/driver", 500)
    assert steps.account.ready()


def test_a_tick_is_repeated_while_an_answer_is_missing() -> None:
    """A tick or an answer that was lost on the way stops nothing."""
    steps = Steps().joined("/driver")
    steps.account.sent(2000)
    assert not steps.account.to_repeat()
    steps.now_s += 1.1 * REPEAT_S
    assert steps.account.to_repeat()
    steps.account.sent(2000)
    assert not steps.account.to_repeat()
