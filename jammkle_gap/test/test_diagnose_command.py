"""`jammkle gap diagnose`: from bags with a known effect to verdict, page, corrected simulator and JSON."""

from __future__ import annotations

import dataclasses
import json
import os
import signal
from typing import TYPE_CHECKING, Any

import pytest
import yaml
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from jammkle_gap import diagnosing as gap_diagnosing
from jammkle_gap.ankle.corrected import load_correction
from jammkle_graph.bags.definitions import MessageDefinitions, share_folders
from jammkle_graph.command.main import main
from jammkle_sim.commands.rig_bag import write_bag
from jammkle_sim.rigs.catalogue import as_it_is, run_rig
from jammkle_sim.rigs.pressure import PressureOptions

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

SHORT = PressureOptions(cycles=2, jam_time_s=0.8, vent_time_s=0.4)
TRUE_LEAK = 0.003
STANDARD = {
    "std_msgs/msg/Bool", "std_msgs/msg/Float32", "sensor_msgs/msg/FluidPressure", "sensor_msgs/msg/JointState",
}  # fmt: skip
KEYS = {
    "verdict", "effects", "set", "probabilities", "where", "gap", "next_experiment", "runtime", "finished",
    "summary", "check", "bags", "references", "rigs", "library", "page", "corrected", "noise", "dropped", "notes",
}  # fmt: skip


@pytest.fixture(autouse=True)
def _own_signals() -> Iterator[None]:
    """Give the test process its signal handlers back; the command installs its own."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


def bag(folder: Path, name: str, seed: int, effects: str = "", options: PressureOptions = SHORT) -> Path:
    """Run the pressure rig, with effects that the bag does not tell of, and write a bag."""
    change: Callable[..., Any] = as_it_is
    if effects:
        file = folder / f"{name}.yaml"
        file.write_text(effects, encoding="utf-8")
        change = load_correction(file)
    run = run_rig("pressure", dataclasses.replace(options, seed=seed), lambda _: None, lambda: False, change)
    write_bag(run, folder / name, "/", MessageDefinitions(share_folders()))
    return folder / name


@pytest.fixture(scope="module")
def leaking(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Record an ankle whose Achilles line leaks."""
    folder = tmp_path_factory.mktemp("leaking")
    return bag(folder, "leaking", 3, f"line_leak_achilles: {{conductance_dm3_s_bar: {TRUE_LEAK}}}")


@pytest.fixture(scope="module")
def diagnosed(leaking: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """Diagnose it, and return the folder and the JSON."""
    folder = tmp_path_factory.mktemp("diagnosed")
    assert main(["gap", "diagnose", str(leaking), "-o", str(folder), "--json", str(folder / "gap.json")]) == 0
    return folder, json.loads((folder / "gap.json").read_text(encoding="utf-8"))


def test_a_leak_is_named_sized_and_placed(diagnosed: tuple[Path, dict[str, Any]]) -> None:
    """The leak that was put in is the effect found, its size lies in the interval, and pneumatics alone is to blame."""
    _, found = diagnosed
    assert found["verdict"] == "EFFECTS"
    assert [effect["name"] for effect in found["effects"]] == ["line_leak_achilles"]
    size = found["effects"][0]["parameters"]["conductance_dm3_s_bar"]
    assert size["interval"][0] <= TRUE_LEAK <= size["interval"][1]
    assert "push-fit" in " ".join(found["check"])
    assert [each["name"] for each in found["subsystems"] if each["to_blame"]] == ["pneumatics"]
    assert found["where"][0]["signal"].endswith("/pressure")
    assert found["gap"]["closed"] > 0.9


def test_the_json_holds_what_was_promised(diagnosed: tuple[Path, dict[str, Any]]) -> None:
    """Every key is there, probabilities and shares add up to one, and intervals hold what they are of."""
    _, found = diagnosed
    assert set(found) >= KEYS
    assert sum(found["probabilities"].values()) == pytest.approx(1.0)
    assert sum(place["share"] for place in found["where"]) == pytest.approx(1.0)
    for place in found["where"]:
        assert {"signal", "phase", "subsystem", "share", "interval"} <= set(place)
    assert {"nominal", "with_effect", "floor", "closed", "interval", "signals"} <= set(found["gap"])
    for closing in (found["gap"], *found["gap"]["signals"].values()):
        if closing["closed"] is not None:
            assert closing["interval"][0] - 1e-9 <= closing["closed"] <= closing["interval"][1] + 1e-9
    assert found["set"][0]["names"] == ["line_leak_achilles"]
    assert found["finished"] is True
    assert found["runtime"]["simulator_runs"] > 0
    assert found["library"] == {"effects": len(found["probabilities"]) - 2, "file": None}


def test_the_page_tells_it(diagnosed: tuple[Path, dict[str, Any]]) -> None:
    """The page holds the verdict, what to check, and every signal that was compared, in less than 5 MB."""
    folder, found = diagnosed
    text = (folder / "gap.html").read_text(encoding="utf-8")
    assert found["page"] == str(folder / "gap.html")
    assert len(text.encode()) < 5e6
    assert "The achilles line leaks" in text
    assert all(name in text for name in found["gap"]["signals"])


def test_the_corrected_simulator_closes_the_gap(diagnosed: tuple[Path, dict[str, Any]], tmp_path: Path) -> None:
    """A run with corrected.yaml evacuates as far as the leaking machine does, and one without it further."""
    folder, _ = diagnosed
    file = folder / "corrected.yaml"
    table = yaml.safe_load(file.read_text(encoding="utf-8"))
    assert list(table) == ["line_leak_achilles"]
    truth = tmp_path / "truth.yaml"
    truth.write_text(yaml.safe_dump({"line_leak_achilles": {"conductance_dm3_s_bar": TRUE_LEAK}}), encoding="utf-8")
    lowest_pa = {}
    for name, change in (("nominal", as_it_is), ("corrected", load_correction(file)), ("true", load_correction(truth))):
        run = run_rig("pressure", dataclasses.replace(SHORT, seed=3), lambda _: None, lambda: False, change)
        lowest_pa[name] = run.topics["manifold/pressure"].column("fluid_pressure_pa").min()
    off_pa = {name: abs(value - lowest_pa["true"]) for name, value in lowest_pa.items()}
    assert off_pa["corrected"] < 0.1 * off_pa["nominal"]


def test_a_slow_valve_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A dead time that the simulator is told not to have is found, and the terminal says it in 80 columns."""
    slow = bag(tmp_path, "slow", 7, options=dataclasses.replace(SHORT, valve_dead_time_s=0.04))
    out = tmp_path / "out"
    code = main(
        [
            "gap",
            "diagnose",
            str(slow),
            "--set",
            "valve-dead-time-s=0.01",
            "-o",
            str(out),
            "--json",
            f"{tmp_path}/x.json",
        ]
    )
    assert code == 0
    found = json.loads((tmp_path / "x.json").read_text(encoding="utf-8"))
    assert found["set"][0]["names"] == ["valve_dead_time"]
    assert found["set"][0]["effects"][0]["parameters"]["extra_s"]["value"] == pytest.approx(0.03, abs=0.004)
    said = capsys.readouterr().out
    assert "valve switching is late" in said
    assert max(len(line.rstrip()) for line in said.splitlines() if str(tmp_path) not in line) <= 80


def write_foreign(source: Path, target: Path) -> None:
    """Write what a bag holds in standard types as another recorder would: wall clock, neighbours swapped, some lost."""
    store, later_ns = get_typestore(Stores.ROS2_JAZZY), 1_700_000_000_000_000_000
    with AnyReader([source]) as reader, Writer(target, version=8, storage_plugin=StoragePlugin.SQLITE3) as writer:
        wanted = [each for each in reader.connections if each.msgtype in STANDARD]
        added = {each.topic: writer.add_connection(each.topic, each.msgtype, typestore=store) for each in wanted}
        for count, (connection, log_ns, data) in enumerate(reader.messages(wanted)):
            message: Any = reader.deserialize(data, connection.msgtype)
            late_ns = 0
            if hasattr(message, "header"):
                message.header.stamp.sec += later_ns // 1_000_000_000
                late_ns = 11_000_000 * (count % 7 == 0)
                if count % 101 == 0:
                    continue
            content = store.serialize_cdr(message, connection.msgtype)
            writer.write(added[connection.topic], log_ns + later_ns + late_ns, content)


def test_a_bag_of_another_recorder_is_diagnosed_with_its_rig_by_hand(leaking: Path, tmp_path: Path) -> None:
    """Standard types alone, no description: without --rig it is refused, with it and --set the leak is named."""
    write_foreign(leaking, tmp_path / "foreign")
    call = ["gap", "diagnose", str(tmp_path / "foreign"), "-o", str(tmp_path / "out"), "--json", f"{tmp_path}/x.json"]
    assert main(call) == 2
    known = [f"--set={name}={getattr(SHORT, name)}" for name in ("cycles", "jam_time_s", "vent_time_s")]
    assert main([*call, "--rig", "pressure", *known]) == 0
    found = json.loads((tmp_path / "x.json").read_text(encoding="utf-8"))
    assert [each["names"] for each in found["set"]] == [["line_leak_achilles"]]
    assert any("load_cell/wrench" in note for note in found["notes"])


def test_in_parts_effects_come_on_top_of_what_references_tell(tmp_path: Path) -> None:
    """Stiff tendons are how this machine is; a leak is what has changed, and what was told stands in the notes."""
    stiff = "tendon_stiffness: {scale: 1.3}"
    healthy = [str(bag(tmp_path, f"healthy_{seed}", seed, stiff)) for seed in (11, 12)]
    leaking = bag(tmp_path, "leaking", 13, f"{stiff}\nline_leak_manifold: {{conductance_dm3_s_bar: {TRUE_LEAK}}}")
    call = ["gap", "diagnose", str(leaking), "--reference", healthy[0], "--reference", healthy[1]]
    call += ["--simulate", "parts", "-o", str(tmp_path / "out"), "--json", str(tmp_path / "x.json")]
    assert main(call) == 0
    found = json.loads((tmp_path / "x.json").read_text(encoding="utf-8"))
    assert found["set"][0]["names"] == ["line_leak_manifold"]
    assert found["simulated"] == "parts"
    told = next(note for note in found["notes"] if "references tell" in note)
    assert float(told.partition("tendon_stiffness.scale ")[2].partition(",")[0]) == pytest.approx(1.3, abs=0.1)


def test_a_run_without_a_gap_has_none(tmp_path: Path) -> None:
    """Another seed of the very same rig is no gap, names nothing, and corrects nothing."""
    same = bag(tmp_path, "same", 11)
    assert main(["gap", "diagnose", str(same), "-o", str(tmp_path), "--json", str(tmp_path / "x.json")]) == 0
    found = json.loads((tmp_path / "x.json").read_text(encoding="utf-8"))
    assert (found["verdict"], found["effects"], found["check"]) == ("NO_GAP", [], [])
    assert yaml.safe_load((tmp_path / "corrected.yaml").read_text(encoding="utf-8")) is None


def test_what_cannot_be_told_apart_is_a_set(tmp_path: Path) -> None:
    """One soft tendon pulled without vacuum may be warm, torn or short of fibres: all are named, and how to know."""
    (tmp_path / "soft.yaml").write_text("tendon_stiffness: {scale: 0.8}", encoding="utf-8")
    pull = ["rig", "tensile", "--speed-m-s", "0.02", "--effects", str(tmp_path / "soft.yaml"), "-o", f"{tmp_path}/pull"]
    assert main(pull) == 0
    code = main(["gap", "diagnose", f"{tmp_path}/pull", "-o", f"{tmp_path}/out", "--json", f"{tmp_path}/x.json"])
    assert code == 0
    found = json.loads((tmp_path / "x.json").read_text(encoding="utf-8"))
    assert found["verdict"] == "AMBIGUOUS"
    assert {"tendon_stiffness", "fibre_loss_peroneal_left"} <= {name for each in found["set"] for name in each["names"]}
    assert found["next_experiment"]["difference"] > 1.0
    assert found["next_experiment"]["name"] in (tmp_path / "out" / "gap.html").read_text(encoding="utf-8")


def test_ctrl_c_keeps_what_is_known(
    leaking: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """SIGINT in the middle of the search ends it with results that say they are not finished."""
    whole = gap_diagnosing.diagnose_recordings

    def interrupted(*arguments: Any, on_progress: Callable[[str, float, float], None], **options: Any) -> Any:
        def report_and_interrupt(stage: str, share: float, left_s: float) -> None:
            on_progress(stage, share, left_s)
            if stage == "fitting single effects":
                os.kill(os.getpid(), signal.SIGINT)

        return whole(*arguments, on_progress=report_and_interrupt, **options)

    monkeypatch.setattr(gap_diagnosing, "diagnose_recordings", interrupted)
    out = tmp_path / "out"
    assert main(["gap", "diagnose", str(leaking), "-o", str(out), "--json", str(tmp_path / "x.json")]) == 0
    assert json.loads((tmp_path / "x.json").read_text(encoding="utf-8"))["finished"] is False
    assert 'id="unfinished"' in (out / "gap.html").read_text(encoding="utf-8")
    assert "STOPPED EARLY" in capsys.readouterr().out
    assert "provisional" in (out / "corrected.yaml").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["{folder}/nowhere"], "nowhere"),
        (["{bag}", "{bag}"], "is given twice"),
        (["{bag}", "--reference", "{bag}"], "as a reference too"),
        (["{bag}", "--rig", "catapult"], "known are: tensile"),
        (["{bag}", "--rig", "tensile"], "was recorded on rig 'pressure'"),
        (["{bag}", "--set", "colour=red"], "no option of rig pressure"),
        (["{bag}", "--set", "vacuum_pa"], "NAME=VALUE"),
        (["{bag}", "--set", "vacuum_pa=["], "cannot be read"),
        (["{bag}", "--set", "vacuum_pa=-5"], "6000 to 75000 Pa"),
        (["{bag}", "--reference", "{folder}/gone"], "gone does not exist"),
        (["{bag}", "--library", "{folder}/fails.yaml"], "fails with KeyError: 'stifness'; mend it in"),
        (["{bag}", "--jobs", "0"], "1 or more"),
        (["{bag}", "--library", "{folder}/bad.yaml"], "maximum"),
        (["{bag}", "--json", "{folder}/no/where.json"], "cannot be written"),
        (["{bag}", "-o", "{folder}/bad.yaml"], "cannot be made"),
    ],
)
def test_bad_input_is_one_line(
    leaking: Path, tmp_path: Path, arguments: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """What cannot be used is refused with exit code 2 and one line that names it; nothing is written."""
    (tmp_path / "bad.yaml").write_text(
        "my_effect: {subsystem: air, sentence: It leaks., change: leak, "
        "parameters: {size: {unit: m, 'null': 0, minimum: 0, source: a guess}}}",
        encoding="utf-8",
    )
    (tmp_path / "fails.yaml").write_text(
        "my_effect: {subsystem: air, sentence: It leaks., change: 'fails.py:change', "
        "parameters: {size: {unit: m, null: 0, minimum: 0, maximum: 1, source: a guess}}}",
        encoding="utf-8",
    )
    (tmp_path / "fails.py").write_text("def change(*_):\n    raise KeyError('stifness')\n", encoding="utf-8")
    filled = [each.format(folder=tmp_path, bag=leaking) for each in arguments]
    out = [] if "-o" in filled else ["-o", str(tmp_path / "out")]
    assert main(["gap", "diagnose", *filled, *out]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
    assert not list(tmp_path.glob("out/*"))
