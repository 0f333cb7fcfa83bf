"""`jammkle gap diagnose`: from bags with a known effect to verdict, page, corrected simulator and JSON."""

from __future__ import annotations

import contextlib
import dataclasses
import io
import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
import yaml
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from jammkle_common.bags.definitions import MessageDefinitions, share_folders
from jammkle_common.bags.run_sheet import FILE_NAME
from jammkle_common.command.main import main
from jammkle_gap import ankle_library, commands
from jammkle_gap import diagnosing as gap_diagnosing
from jammkle_gap.ankle.corrected import load_correction
from jammkle_gap.ankle.sensors import SensorSet
from jammkle_sim.commands.bag import write_bags
from jammkle_sim.rigs.catalogue import as_it_is, run_rig
from jammkle_sim.rigs.pressure import PressureOptions

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

SHORT = PressureOptions(cycles=2, jam_time_s=0.8, vent_time_s=0.4)
TRUE_LEAK = 0.003
STANDARD = {
    "std_msgs/msg/Bool", "std_msgs/msg/Float32", "sensor_msgs/msg/FluidPressure", "sensor_msgs/msg/JointState",
}  # fmt: skip
KEYS = {
    "verdict", "reasons", "effects", "set", "posterior", "gap_probability", "p_value", "false_alarm_rate",
    "where", "subsystems", "gap", "classes", "silent", "calibration", "references_left", "next_experiment", "notes",
    "finished", "runtime", "summary", "check", "bags", "references", "rigs", "sensors", "library", "page", "corrected",
    "made", "answers",
}  # fmt: skip
FEW = (
    "line_leak_achilles", "line_leak_manifold", "pump_wear", "valve_dead_time", "trapped_volume", "command_delay",
    "pressure_delay",
)  # fmt: skip
"""Effects on offer where the whole library would only take time."""
ALONE = ("--jobs", "1")
"""In this process: others would take longer to start than a few effects take. The whole library is spread over some."""


def bag(folder: Path, name: str, seed: int, effects: str = "", options: PressureOptions = SHORT) -> Path:
    """Run the pressure rig, with effects that the bag does not tell of, and write a bag."""
    change: Callable[..., Any] = as_it_is
    if effects:
        file = folder / f"{name}.yaml"
        file.write_text(effects, encoding="utf-8")
        change = load_correction(file)
    run = run_rig("pressure", dataclasses.replace(options, seed=seed), lambda _: None, lambda: False, change)
    write_bags({"": run}, folder / name, "/", MessageDefinitions(share_folders()))
    return folder / name


@pytest.fixture(scope="module", autouse=True)
def _own_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Keep signatures for these tests alone, so that each is simulated once, and none is left over from before."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(scope="module")
def healthy(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Record references, and return the arguments that hand them over."""
    folder = tmp_path_factory.mktemp("healthy")
    return [part for seed in (21, 22, 23) for part in ("--since", str(bag(folder, f"healthy_{seed}", seed)))]


def few(effects: Sequence[str] = FEW) -> list[str]:
    """Arguments that offer a few effects alone."""
    known = {effect.name for effect in ankle_library()}
    return [part for name in effects if name in known for part in ("--only", name)]


@pytest.fixture(scope="module")
def leaking(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Record an ankle whose Achilles line leaks."""
    folder = tmp_path_factory.mktemp("leaking")
    return bag(folder, "leaking", 3, f"line_leak_achilles: {{conductance_dm3_s_bar: {TRUE_LEAK}}}")


@pytest.fixture(scope="module")
def diagnosed(
    leaking: Path, healthy: list[str], tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, dict[str, Any], str]:
    """Diagnose it with all effects on offer, and return the folder, the JSON, and what was said before the end."""
    folder = tmp_path_factory.mktemp("diagnosed")
    said = io.StringIO()
    with contextlib.redirect_stderr(said):
        call = ["gap", "diagnose", str(leaking), *healthy, "-o", str(folder), "--json", str(folder / "gap.json")]
        assert main(call) == 0
    return folder, json.loads((folder / "gap.json").read_text(encoding="utf-8")), said.getvalue()


def test_a_leak_is_named_sized_and_placed(diagnosed: tuple[Path, dict[str, Any], str]) -> None:
    """The leak that was put in is in the answer, its size lies in the interval, and pneumatics is the subsystem."""
    _, found, _ = diagnosed
    assert found["verdict"] in {"EFFECTS", "AMBIGUOUS"}
    assert all("line_leak_achilles" in each["names"] for each in found["set"])
    leak = next(effect for effect in found["effects"] if effect["name"] == "line_leak_achilles")
    size = leak["parameters"]["conductance_dm3_s_bar"]
    assert size["interval"][0] <= TRUE_LEAK <= size["interval"][1]
    assert 0.0 < size["detectable"] < TRUE_LEAK
    assert "push-fit" in " ".join(found["check"])
    assert next(iter(found["subsystems"])) == "pneumatics"
    assert found["where"][0]["signal"].endswith("/pressure")
    assert found["gap"]["closed"] > 0.9
    assert found["sensors"] == "robot"
    assert not any("tension" in name for name in found["gap"]["signals"])


def test_a_first_answer_comes_before_the_fits(diagnosed: tuple[Path, dict[str, Any], str]) -> None:
    """What explains most on the grids is said at once, as what it is."""
    _, _, said = diagnosed
    assert "first answer, before any fit: line leak achilles" in said


def test_the_json_holds_what_was_promised(diagnosed: tuple[Path, dict[str, Any], str]) -> None:
    """Every key is there, probabilities and shares add up to one, and intervals hold what they are of."""
    _, found, _ = diagnosed
    assert set(found) >= KEYS
    assert sum(each["probability"] for each in found["posterior"]) == pytest.approx(1.0)
    assert [] in [each["names"] for each in found["posterior"]]
    assert sum(place["share"] for place in found["where"]) == pytest.approx(1.0)
    for place in found["where"]:
        assert {"signal", "phase", "share", "interval", "gap"} <= set(place)
    assert {"nominal", "corrected", "closed", "interval", "signals", "held_out"} <= set(found["gap"])
    assert found["gap"]["interval"][0] - 1e-9 <= found["gap"]["closed"] <= found["gap"]["interval"][1] + 1e-9
    assert "line_leak_achilles" in found["set"][0]["names"]
    assert found["finished"] is True
    assert found["runtime"]["simulator_runs"] > 0
    assert found["library"] == {"effects": len(ankle_library().effects), "file": None}


def test_the_page_tells_it(diagnosed: tuple[Path, dict[str, Any], str]) -> None:
    """The page holds the verdict, what to check, and every signal that was compared, in less than 5 MB."""
    folder, found, _ = diagnosed
    text = (folder / "gap.html").read_text(encoding="utf-8")
    assert found["page"] == str(folder / "gap.html")
    assert len(text.encode()) < 5e6
    assert "The achilles line leaks" in text
    assert all(name in text for name in found["gap"]["signals"])


def test_the_corrected_simulator_closes_the_gap(diagnosed: tuple[Path, dict[str, Any], str], tmp_path: Path) -> None:
    """A run with corrected.yaml evacuates as far as the leaking machine does, and one without it further."""
    folder, _, _ = diagnosed
    file = folder / "corrected.yaml"
    assert "line_leak_achilles" in yaml.safe_load(file.read_text(encoding="utf-8"))
    truth = tmp_path / "truth.yaml"
    truth.write_text(yaml.safe_dump({"line_leak_achilles": {"conductance_dm3_s_bar": TRUE_LEAK}}), encoding="utf-8")
    lowest_pa = {}
    for name, change in (("nominal", as_it_is), ("corrected", load_correction(file)), ("true", load_correction(truth))):
        run = run_rig("pressure", dataclasses.replace(SHORT, seed=3), lambda _: None, lambda: False, change)
        lowest_pa[name] = run.topics["manifold/pressure"].column("fluid_pressure_pa").min()
    off_pa = {name: abs(value - lowest_pa["true"]) for name, value in lowest_pa.items()}
    assert off_pa["corrected"] < 0.1 * off_pa["nominal"]


def test_a_slow_valve_is_named(healthy: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A dead time that is not on the run sheet is found, and the terminal says it in 80 columns."""
    slow = bag(tmp_path, "slow", 7, options=dataclasses.replace(SHORT, valve_dead_time_s=0.04))
    call = ["gap", "diagnose", str(slow), *healthy, *few(), *ALONE, "-o", str(tmp_path / "out")]
    call += ["--json", f"{tmp_path}/x.json"]
    (slow / FILE_NAME).write_text(f"options: {{valve_dead_time_s: {SHORT.valve_dead_time_s}}}", encoding="utf-8")
    assert main(call) == 0
    found = json.loads((tmp_path / "x.json").read_text(encoding="utf-8"))
    assert "valve_dead_time" in found["set"][0]["names"]
    sized = {effect["name"]: effect["parameters"] for effect in found["set"][0]["effects"]}
    late_s = 0.04 - SHORT.valve_dead_time_s
    assert sized["valve_dead_time"]["extra_s"]["value"] == pytest.approx(late_s, abs=0.006)
    said = capsys.readouterr().out
    assert "valve dead time" in said
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


def test_bags_of_another_recorder_are_diagnosed_with_their_rig_by_hand(
    leaking: Path, healthy: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Standard types alone: without a run sheet they are refused, with one for all of them the leak is named."""
    write_foreign(leaking, tmp_path / "foreign")
    references = []
    for place in map(Path, healthy[1::2]):
        write_foreign(place, tmp_path / place.name)
        references += ["--since", str(tmp_path / place.name)]
    offered = few(("line_leak_achilles", "pump_wear", "valve_dead_time"))
    call = ["gap", "diagnose", str(tmp_path / "foreign"), *offered, "-o", str(tmp_path / "out")]
    call += ["--json", f"{tmp_path}/x.json", *ALONE]
    assert main([*call, *references]) == 2
    options = {name: getattr(SHORT, name) for name in ("cycles", "jam_time_s", "vent_time_s")}
    sheet = {"rig": "pressure", "options": options}
    (tmp_path / FILE_NAME).write_text(yaml.safe_dump(sheet), encoding="utf-8")
    assert main([*call, *references]) == 0
    found = json.loads((tmp_path / "x.json").read_text(encoding="utf-8"))
    assert "line_leak_achilles" in found["set"][0]["names"]
    assert found["rigs"] == ["pressure"]
    capsys.readouterr()
    (tmp_path / FILE_NAME).unlink()
    assert main([*call, *healthy, "--rig", "pressure"]) == 2
    assert "no reference is a repeat of recording foreign: healthy_21: " in capsys.readouterr().err


def test_a_run_without_a_gap_has_none(healthy: list[str], tmp_path: Path) -> None:
    """Another seed of the very same rig is no gap, names nothing, and corrects nothing."""
    call = ["gap", "diagnose", str(bag(tmp_path, "same", 11)), *healthy, *few(), *ALONE]
    assert main([*call, "-o", str(tmp_path), "--json", str(tmp_path / "x.json")]) == 0
    found = json.loads((tmp_path / "x.json").read_text(encoding="utf-8"))
    assert (found["verdict"], found["effects"], found["check"]) == ("NO_GAP", [], [])
    assert yaml.safe_load((tmp_path / "corrected.yaml").read_text(encoding="utf-8")) is None


def test_without_references_the_simulator_is_compared_with_the_machine(leaking: Path, tmp_path: Path) -> None:
    """The ledger is in the answer and on the page; the corrected file holds constants, and is loaded."""
    offered = few(("line_leak_achilles", "pump_wear"))
    call = ["gap", "diagnose", str(leaking), *offered, *ALONE, "-o", str(tmp_path), "--json", f"{tmp_path}/x.json"]
    assert main(call) == 0
    found = json.loads((tmp_path / "x.json").read_text(encoding="utf-8"))
    assert found["verdict"] in {"EFFECTS", "AMBIGUOUS"}
    assert found["set"][0]["names"] == ["line_leak_achilles"]
    parts = {each["part"]: each["share"] for each in found["ledger"]}
    assert sum(parts.values()) == pytest.approx(1.0, abs=1e-6)
    assert max(parts, key=lambda name: parts[name]) == "line_leak_achilles"
    page = (tmp_path / "gap.html").read_text(encoding="utf-8")
    assert 'id="waterfall"' in page
    correction = load_correction(tmp_path / "corrected.yaml")
    constants = {name: each["value"] for name, each in found["constants"].items() if each["value"] != each["nominal"]}
    assert constants.items() <= correction.values.items()
    run = ["rig", "pressure", "--effects", str(tmp_path / "corrected.yaml"), "-o", str(tmp_path / "again")]
    assert main(run) == 0


def test_what_cannot_be_told_apart_is_said_to_be(tmp_path: Path) -> None:
    """One soft tendon pulled without vacuum may be warm or short of fibres: all are named, and the page says so."""
    (tmp_path / "soft.yaml").write_text("tendon_stiffness: {scale: 0.8}", encoding="utf-8")
    pull = ["rig", "tensile", "--speed-mm-s", "20", "--extension-mm", "10"]
    assert main([*pull, "--repeats", "3", "--seed", "5", "-o", f"{tmp_path}/healthy"]) == 0
    assert main([*pull, "--effects", str(tmp_path / "soft.yaml"), "-o", f"{tmp_path}/pull"]) == 0
    call = ["gap", "diagnose", f"{tmp_path}/pull", *few(("tendon_stiffness", "fibre_loss_peroneal_left", "pump_wear"))]
    call += [part for i in range(3) for part in ("--since", f"{tmp_path}/healthy_{i}")]
    assert main([*call, *ALONE, "-o", f"{tmp_path}/out", "--json", f"{tmp_path}/x.json"]) == 0
    found = json.loads((tmp_path / "x.json").read_text(encoding="utf-8"))
    assert found["verdict"] in {"EFFECTS", "AMBIGUOUS"}
    assert found["sensors"] == "rig"
    said = {name for each in found["set"] for name in (*each["names"], *each["equivalents"])}
    assert {"tendon_stiffness", "fibre_loss_peroneal_left"} <= said
    page = (tmp_path / "out" / "gap.html").read_text(encoding="utf-8")
    if found["next_experiment"] is not None:
        assert found["next_experiment"]["name"] in page
    else:
        assert "(in the credible set)" in page


def interrupting(stage: str) -> Callable[..., Any]:
    """A diagnosis to which Ctrl-C comes as soon as it has begun something."""
    whole = gap_diagnosing.diagnose_recordings

    def interrupted(*arguments: Any, progress: Callable[[str, float], None], **options: Any) -> Any:
        def report_and_interrupt(what: str, share: float) -> None:
            progress(what, share)
            if what == stage:
                os.kill(os.getpid(), signal.SIGINT)

        return whole(*arguments, progress=report_and_interrupt, **options)

    return interrupted


def test_ctrl_c_keeps_what_is_known(
    leaking: Path,
    healthy: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """SIGINT amid the fits ends them with results that say they are not finished."""
    monkeypatch.setattr(gap_diagnosing, "diagnose_recordings", interrupting("fitting"))
    out = tmp_path / "out"
    call = ["gap", "diagnose", str(leaking), *healthy, *few(), "-o", str(out), "--json", str(tmp_path / "x.json")]
    assert main(call) == 0
    assert json.loads((tmp_path / "x.json").read_text(encoding="utf-8"))["finished"] is False
    assert 'id="unfinished"' in (out / "gap.html").read_text(encoding="utf-8")
    assert "STOPPED EARLY" in capsys.readouterr().out
    assert "provisional" in (out / "corrected.yaml").read_text(encoding="utf-8")


def test_ctrl_c_before_anything_is_known_ends_in_order(
    leaking: Path, healthy: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """SIGINT before the first answer leaves nothing behind and ends as shells expect it."""
    monkeypatch.setattr(gap_diagnosing, "diagnose_recordings", interrupting("nominal"))
    assert main(["gap", "diagnose", str(leaking), *healthy, *few(), *ALONE, "-o", str(tmp_path / "out")]) == 130
    assert not (tmp_path / "out").exists()


def test_one_bad_bag_of_several_is_one_line(leaking: Path, tmp_path: Path) -> None:
    """Bags are read by several processes; what one of them cannot read is said once, and none of them complains."""
    broken = tmp_path / "broken"
    shutil.copytree(leaking, broken)
    (file,) = broken.glob("*.mcap")
    file.write_bytes(file.read_bytes()[:-1000])
    call = [sys.executable, "-m", "jammkle_common.command", "gap", "diagnose", str(leaking), str(broken)]
    done = subprocess.run([*call, "-o", str(tmp_path / "out")], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "broken was not completed" in done.stderr
    assert done.stderr.count("\n") == 1


def test_the_command_knows_the_sets_of_sensors() -> None:
    """The option offers what there is."""
    assert {each.value for each in commands.Sensors} == {each.value for each in SensorSet}


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["{folder}/nowhere"], "nowhere"),
        (["{bag}", "{bag}"], "is given twice"),
        (["{bag}", "--since", "{bag}"], "as a reference too"),
        (["{bag}", "--rig", "catapult"], "known are: tensile"),
        (["{bag}", "--rig", "tensile"], "was recorded on rig 'pressure'"),
        (["{bag}", "--since", "{folder}/gone"], "gone does not exist"),
        (["{bag}", "--library", "{folder}/fails.yaml"], "fails with KeyError: 'stifness'; mend it in"),
        (["{bag}", "--jobs", "0"], "1 or more"),
        (["{bag}", "--sensors", "eyes"], "'robot', 'rig', 'instrumented'"),
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
    assert not (tmp_path / "out").exists()
