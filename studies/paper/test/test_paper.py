"""`make paper`: numbers compared as stated, every row and figure on the page, results for machines."""

from __future__ import annotations

import html
import json
import math
import multiprocessing
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from jammkle_common.command.errors import Interrupted
from jammkle_common.command.main import run
from jammkle_common.parameters import ParameterError
from jammkle_sim.physics.ankle import AnkleParameters
from jammkle_sim.physics.constants import TENDON_SETS
from jammkle_sim.rigs.slip import Footing, SlipOptions
from studies.paper import __main__ as paper_command
from studies.paper.comparison import Outcomes, RowComparison, Statistic, compare_claims
from studies.paper.figures import deformation
from studies.paper.reasons import REASONS
from studies.paper.runs import (
    ENERGY,
    HANGING,
    PARAMETER_SETS,
    ROW_EXPERIMENTS,
    SLIP_EXPERIMENTS,
    SLIP_JAMMED,
    SLIP_RIGID,
    SLIP_UNJAMMED,
    Curve,
    HangingSlip,
    Outcome,
    Task,
    run_all,
    run_task,
)
from studies.paper.tables import DROP_ROWS, ROWS, SLIP_CLAIMS, TENSILE_ROWS, paper_row

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

TABLES = Path(__file__).parents[4] / "shared" / "paper" / "tables.yaml"
"""The paper's numbers as they were handed over, where they lie beside the checkout."""
NO_CURVE = Curve(np.array([0.0, 20.0, 0.0]), np.array([0.0, 10.0, 0.0]))


def made_up(task: Task) -> Outcome:
    """Stand in for a run: the paper's mean, half a standard error up and down over two repeats."""
    known = {row.identifier: row for row in ROWS}
    row = known.get(task.experiment.identifier)
    mean, error = (row.mean, row.standard_error) if row else (30.0, 1.0)
    peak = mean + (0.5 if task.repeat else -0.5) * error
    results = {"peak_force_n": peak, "peak_before_heel_n": peak, "peak_deceleration_m_s2": peak, ENERGY: 1.0}
    return Outcome(task, results, (), NO_CURVE)


def made_up_all(
    tasks: Sequence[Task], on_done: Callable[[int, Task], None], _asked_to_stop: Callable[[], bool]
) -> tuple[Outcome, ...]:
    """Stand in for all runs."""
    for done, task in enumerate(tasks, start=1):
        on_done(done, task)
    return tuple(made_up(task) for task in tasks)


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, dict[str, Any]]:
    """Write page and JSON of made-up runs."""
    folder = tmp_path_factory.mktemp("paper") / "new"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(paper_command, "run_all", made_up_all)
        assert run(paper_command.app, ["-o", str(folder), "--repeats", "2", "--json", str(folder / "paper.json")]) == 0
    content = json.loads((folder / "paper.json").read_text())
    return (folder / "paper.html").read_text(), content


def test_the_papers_numbers_are_those_that_were_handed_over() -> None:
    """Each row's identifier, largest, mean and standard error is that of tables.yaml, in both directions."""
    if not TABLES.exists():
        pytest.skip(f"{TABLES} is not there")
    given_tables = yaml.safe_load(TABLES.read_text())
    for rows, given_rows in (
        (TENSILE_ROWS, given_tables["tensile_test"]["peak_force"]),
        (DROP_ROWS, given_tables["drop_test"]["peak_deceleration"]),
    ):
        ours = {row.identifier: (row.largest, row.mean, row.standard_error, row.clipped) for row in rows}
        assert ours == {
            name: (row["max"], row["mean"], row["se"], row.get("clipped", False)) for name, row in given_rows.items()
        }
    assert [claim.text for claim in SLIP_CLAIMS] == given_tables["slip_test"]["claims"]


def test_the_difference_is_in_standard_errors_of_the_paper() -> None:
    """Z is the simulated mean less the paper's over the paper's standard error."""
    row = paper_row("multi_vac50")
    compared = RowComparison(row, "fitted", Statistic.of([51.0, 52.0, 53.0]))
    assert compared.z == pytest.approx((52.0 - 50.214) / 0.864)
    assert not compared.reproduced
    assert RowComparison(row, "fitted", Statistic.of([50.214 * 1.029])).reproduced
    assert RowComparison(row, "fitted", Statistic.of([50.214 - 1.9 * 0.864])).reproduced


@given(st.lists(st.floats(-1e6, 1e6), min_size=2, max_size=20), st.floats(-1e3, 1e3))
def test_a_statistic_moves_with_its_values(values: list[float], shift: float) -> None:
    """Shifting all values shifts mean and largest alike and leaves the standard error."""
    before, after = Statistic.of(values), Statistic.of([value + shift for value in values])
    assert after.mean == pytest.approx(before.mean + shift, abs=1e-6)
    assert after.largest == pytest.approx(before.largest + shift, abs=1e-6)
    assert after.standard_error == pytest.approx(before.standard_error, abs=1e-6)


def test_the_standard_error_is_that_of_the_mean() -> None:
    """Five values 1 to 5 have the standard error sqrt(2.5 / 5); a single one has none."""
    assert Statistic.of([1.0, 2.0, 3.0, 4.0, 5.0]).standard_error == pytest.approx(math.sqrt(0.5))
    assert math.isnan(Statistic.of([1.0]).standard_error)


@pytest.mark.parametrize(
    ("rigid", "unjammed", "jammed", "energies", "holds"),
    [
        (26.0, 28.0, 50.0, (1.0, 1.2, 2.2), [True, True, True]),
        (60.0, 28.0, 50.0, (1.0, 1.2, 2.2), [False, False, True]),
        (26.0, 28.0, 50.0, (1.0, 1.2, 1.4), [True, True, False]),
        (3.0, 28.0, 50.0, (0.2, 1.2, 2.2), [True, False, True]),
    ],
)
def test_claims_hold_when_the_numbers_say_so(
    rigid: float, unjammed: float, jammed: float, energies: tuple[float, float, float], holds: list[bool]
) -> None:
    """Largest peak, similar peak and more energy are told apart; a peak after the heel landed counts for none."""
    feet = zip((SLIP_RIGID, SLIP_UNJAMMED, SLIP_JAMMED), (rigid, unjammed, jammed), energies, strict=True)
    outcomes = [
        Outcome(
            Task(experiment, parameter_set, 0, 0),
            {"peak_before_heel_n": peak, "peak_force_n": 2e3 - peak, ENERGY: energy},
            (),
            NO_CURVE,
        )
        for experiment, peak, energy in feet
        for parameter_set in PARAMETER_SETS
    ]
    assert [claim.holds for claim in compare_claims(Outcomes(outcomes)) if claim.parameter_set == "fitted"] == holds


def test_every_row_is_in_the_results(written: tuple[str, dict[str, Any]]) -> None:
    """The JSON has each row of both tables once per parameter set, with the paper's numbers and z."""
    _, content = written
    keys = {"id", "test", "parameter_set", "paper_mean", "paper_se", "simulated", "z"}
    assert all(set(row) == keys for row in content["rows"])
    assert [(row["id"], row["parameter_set"]) for row in content["rows"]] == [
        (row.identifier, parameter_set) for row in ROWS for parameter_set in PARAMETER_SETS
    ]
    for row in content["rows"]:
        known = paper_row(row["id"])
        assert (row["test"], row["paper_mean"], row["paper_se"]) == (known.test, known.mean, known.standard_error)
        assert row["z"] == pytest.approx((row["simulated"] - known.mean) / known.standard_error)
        assert row["simulated"] == pytest.approx(known.mean)
    assert {claim["id"] for claim in content["claims"]} == {claim.identifier for claim in SLIP_CLAIMS}


def test_every_row_claim_and_reason_is_on_the_page(written: tuple[str, dict[str, Any]]) -> None:
    """A line per row and claim, with title, the three numbers that the paper prints and the sentence on what misses."""
    text = html.unescape(written[0]).replace("\N{NO-BREAK SPACE}", " ")
    for row in ROWS:
        (line,) = re.findall(rf'<tr id="{row.identifier}">.*?</tr>', text, re.DOTALL)
        assert row.title in line
        printed = "".join(f'<td class="n">{number:.3f}</td>' for number in (row.largest, row.mean, row.standard_error))
        assert printed in line
    for claim in SLIP_CLAIMS:
        assert f'<tr id="{claim.identifier}">' in text
    assert all(entry.sentence in text for entry in REASONS)


def test_the_claims_on_feet_that_hang_are_on_the_page(written: tuple[str, dict[str, Any]]) -> None:
    """At every pitch and friction, with what a rigid foot that wedges makes of them."""
    page, content = written
    table = page.partition('<table id="hanging">')[2].partition("</table>")[0]
    assert table.count("<tr>") == len(HANGING) + 1
    assert [(each["hang_pitch_deg"], each["friction"]) for each in content["slip_hanging"]] == [
        (slip.pitch_deg, slip.friction) for slip in HANGING
    ]
    wedged = [each for each in content["slip_hanging"] if each["feet"]["Rigid ankle"] is None]
    assert [each["friction"] for each in wedged] == [0.65, 0.60]
    assert not any(each["claims"] for each in wedged)
    assert not any(each["all_claims_hold"] for each in content["slip_hanging"])
    assert "At none of them do all three claims hold." in page


def test_on_feet_that_hang_every_toe_slides_or_the_rigid_one_wedges() -> None:
    """As the drop rig has them: below the friction that wedges, jamming makes no peak of its own, and no more work."""
    slides = HangingSlip(40.0, 0.55)
    tasks = [Task(each, "fitted", 0, None) for each in slides.runs]
    rigid, unjammed, jammed = (run_task(task).results for task in tasks)
    assert not slides.wedges
    assert max(each["peak_before_heel_n"] for each in (rigid, unjammed, jammed)) < 3.0
    assert jammed[ENERGY] < 1.2 * rigid[ENERGY]
    assert HangingSlip(40.0, 0.60).wedges


def test_the_score_leaves_out_what_no_tendon_decides(written: tuple[str, dict[str, Any]]) -> None:
    """Eight tensile rows are counted; no drop row, each of which is met by construction, and no score is of all."""
    scores = re.findall(r"<b>(\d+) of (\d+) (\w+) rows", written[0])
    assert scores == [("8", "8", "tensile")]
    assert f"of {len(ROWS)}" not in written[0]


def test_what_was_chosen_for_the_drop_rows_is_listed_as_it_stands_in_the_code(written: tuple[str, Any]) -> None:
    """Below the drop table stands each choice with its value: levers, pose, pretension, ball, contacts, sensor."""
    text = html.unescape(written[0])
    (table,) = re.findall(r'<table id="choices">.*?</table>', text, re.DOTALL)
    assert "chosen so that" in table
    assert text.index('<table id="choices">') > text.index(f'<tr id="{DROP_ROWS[-1].identifier}">')
    assert text.index('<table id="choices">') < text.index("<h2>Slip test")
    for what, value in (
        ("lever of the toe", "49.4 mm"),
        ("pretension of the Achilles tendons", "0.5 mm"),
        ("arm of the Achilles tendons", "37.4 mm"),
        ("pose at landing", "40°"),
        ("contact of the toe", "8 ms"),
        ("friction of the floor", "0.1"),
        ("squash ball, cubic part", "1.6e+07 N/m³"),
        ("damping of the squash ball", "35 N s/m"),
        ("contact of the hard feet", "12 ms"),
        ("range of the accelerometer", "80.83"),
    ):
        assert re.search(rf"{what}</td><td>{re.escape(value)}", table)


def test_the_page_shows_the_edge_friction_and_its_limit(written: tuple[str, Any]) -> None:
    """With the slip test stands the condition of the rigid ankle: its friction, and that from which on it wedges."""
    slip_test = html.unescape(written[0]).partition("<h2>Slip test")[2].partition("<h2>")[0]
    options = SlipOptions()
    limit = Footing(options.slope_deg, options.leg_m, AnkleParameters()).wedging_friction
    assert f"is {options.edge_friction:g} " in slip_test
    assert f"is {limit:.3f} " in slip_test
    assert f"lever of the toe, {AnkleParameters().toe_m * 1e3:g} mm" in slip_test
    assert "peak before the heel lands" in slip_test


@pytest.mark.parametrize(
    "words",
    ["low-discrepancy", "met by construction", "at most 4.2 N", "heel lands flat", "critically damped", "116 N"],
)
def test_the_page_says_what_it_does_not_show(written: tuple[str, dict[str, Any]], words: str) -> None:
    """What was chosen for its row, how repeats scatter and what is not reproduced stand among the notes."""
    assert words in html.unescape(written[0]).partition('id="notes"')[2]


def test_every_figure_with_data_has_its_counterpart(written: tuple[str, dict[str, Any]]) -> None:
    """Figures are named as the paper's, and the page asks for nothing outside of itself."""
    text, _ = written
    for name in ("JammingPressurePlots", "SimulatedJamming", "ComsolFig", "fig9", "fig8", "materials", "glance"):
        assert len(re.findall(rf'<figure id="figure-{name}">.*?src="data:image/svg\+xml;base64', text, re.DOTALL)) == 1
    sources: list[str] = []

    class Sources(HTMLParser):
        def handle_starttag(self, _tag: str, attributes: list[tuple[str, str | None]]) -> None:
            sources.extend(value or "" for name, value in attributes if name in {"src", "href"})

    Sources().feed(text)
    assert sources
    assert all(source.startswith(("data:", "#")) for source in sources)
    assert "@import" not in text
    assert "url(" not in text


def test_the_stretch_moves_into_the_stiff_sections_when_jammed() -> None:
    """Unjammed the soft sections take most of the extension; jammed they share it more evenly. All of it is there."""
    free, jammed = (deformation(TENDON_SETS["fitted"], vacuum_pa) for vacuum_pa in (0.0, 50e3))
    assert free.soft_share > 0.75
    assert jammed.soft_share < free.soft_share - 0.15
    for each in (free, jammed):
        assert each.strain.mean() * 80.0 == pytest.approx(20.0, rel=0.01)


def test_runs_in_processes_are_those_in_this_one() -> None:
    """Workers give the results of a direct run, in the order of the tasks, and tell of every run that is done."""
    (drop,) = [each for each in ROW_EXPERIMENTS if each.identifier == "squash_ball"]
    tasks = [Task(drop, "fitted", 3, repeat) for repeat in range(2)]
    reported: list[int] = []
    outcomes = run_all(tasks, lambda done, _: reported.append(done), lambda: False, workers=1)
    assert [outcome.results for outcome in outcomes] == [run_task(task).results for task in tasks]
    assert outcomes[0].results != outcomes[1].results
    assert reported == [1, 2]


def test_a_request_to_stop_ends_the_runs() -> None:
    """Asked to stop, it ends what is on its way, leaves the rest, and no process of it is left."""
    tasks = [Task(SLIP_EXPERIMENTS[0], "fitted", 0, repeat) for repeat in range(2000)]
    before = set(multiprocessing.active_children())  # other tests' idle workers, which joblib keeps for a while
    with pytest.raises(Interrupted):
        run_all(tasks, lambda *_: None, lambda: True, workers=1)
    assert not set(multiprocessing.active_children()) - before


def test_every_experiment_is_one_that_its_rig_accepts() -> None:
    """Options of all rows and slips are in range, for both sets; an unknown set is refused."""
    for experiment in (*ROW_EXPERIMENTS, *SLIP_EXPERIMENTS):
        for parameter_set in PARAMETER_SETS:
            assert experiment.options(parameter_set, 5).seed == 5
        with pytest.raises(ParameterError, match="parameter_set"):
            experiment.options("guessed", 5)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("-o {folder}/page --repeats 1", ("--repeats", "1", "2 to 1000")),
        ("-o {folder}/page --seed -1", ("--seed", "-1")),
        ("-o {folder}/text.yaml", ("text.yaml",)),
        ("-o {folder}/page --json {folder}/no/where.json", ("where.json", "no folder")),
    ],
)
def test_bad_input_gets_one_line_and_two(
    arguments: str, words: tuple[str, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Exit code 2, one line that names the value and what would be right, and nothing is written."""
    (tmp_path / "text.yaml").write_text("no: folder\n")
    before = sorted(tmp_path.rglob("*"))
    assert run(paper_command.app, [part.format(folder=tmp_path) for part in arguments.split()]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert all(word in line for word in words)
    assert sorted(tmp_path.rglob("*")) == before
