"""A blind trial of your own: three cases from your own simulator, with nothing but rosbags and NumPy.

    python studies/blind/test/stranger.py TRIAL KEY.json
    python -m studies.blind --trial TRIAL --key KEY.json -o PAGE

The simulator here is crude: every volume goes to where it is drawn with one time constant. Yours may be a machine.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

STORE = get_typestore(Stores.ROS2_JAZZY)
CHANNELS = ("peroneal_left", "peroneal_right", "achilles")
AIR_PA, DRAWN_PA = 101_325.0, 45e3
DRAW_S, VENT_S, HUM_HZ = 0.09, 0.03, 5.0
START_S, JAM_S, CYCLE_S, END_S, STEP_S = 0.2, 0.8, 1.2, 1.4, 0.01
RUNS, REFERENCES = 2, 5


def simulated(random, offset_pa=0.0, hum_pa=0.0):
    """Return times, what was commanded, and what four sensors read: manifold, then CHANNELS."""
    times = np.arange(0.0, END_S, STEP_S)
    drawing = (times >= START_S) & ((times - START_S) % CYCLE_S < JAM_S)
    pressure = np.full((times.size, 4), AIR_PA)
    slower = random.normal(1.0, 0.01)  # from run to run
    for k in range(1, times.size):
        goal, tau = (DRAWN_PA, DRAW_S) if drawing[k - 1] else (AIR_PA, VENT_S)
        pressure[k] = pressure[k - 1] + STEP_S / (tau * slower) * (goal - pressure[k - 1])
    pressure += random.normal(0.0, 50.0, pressure.shape)
    pressure[:, 3] += offset_pa
    pressure += hum_pa * np.sin(2.0 * np.pi * HUM_HZ * times)[:, None]
    return times, drawing, pressure


def message(kind, *values):
    """Return a message as it lies in a bag."""
    return STORE.serialize_cdr(STORE.types[kind](*values), kind), kind


def header(time_s):
    """Return a header with the sensor's own time."""
    whole = int(time_s)
    stamp = STORE.types["builtin_interfaces/msg/Time"](whole, int((time_s - whole) * 1e9))
    return STORE.types["std_msgs/msg/Header"](stamp, "")


def write(path, random, **fault):
    """Record one run as any recorder would: a bit after the stamps."""
    times, drawing, pressure = simulated(random, **fault)
    rows = [(0.0, "/pump/duty", message("std_msgs/msg/Float32", 0.0))]
    for now, before, at in zip(drawing, [False, *drawing], times, strict=False):
        if now != before:
            rows.append((at, "/pump/duty", message("std_msgs/msg/Float32", 0.5 * now)))
            rows += [(at, f"/{each}/solenoid", message("std_msgs/msg/Bool", bool(now))) for each in CHANNELS]
    for at, row in zip(times, pressure, strict=True):
        late = at + random.uniform(0.0005, 0.002)
        for name, value in zip(("manifold", *CHANNELS), row, strict=True):
            rows.append((late, f"/{name}/pressure", message("sensor_msgs/msg/FluidPressure", header(at), value, 0.0)))
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        topics = {}
        for at, topic, (data, kind) in sorted(rows, key=lambda each: each[0]):
            if topic not in topics:
                topics[topic] = bag.add_connection(topic, kind, typestore=STORE)
            bag.write(topics[topic], int(at * 1e9), data)


CASES = {
    "0001": ({"kind": "none"}, {}),
    "0002": (
        {
            "kind": "single",
            "effects": [{"name": "pressure_sensor_offset_achilles", "parameters": {"offset_pa": 2000.0}}],
            "location": ["sensing"],
        },
        {"offset_pa": 2000.0},
    ),
    "0003": ({"kind": "outside", "what": "mains hum on every pressure"}, {"hum_pa": 1500.0}),
}


def main(trial, key):
    """Write bags and cases, and what is true of them elsewhere."""
    random = np.random.default_rng(5)
    for name, (_, fault) in CASES.items():
        bags = trial / "cases" / name / "bags"
        bags.mkdir(parents=True)
        for k in range(RUNS):
            write(bags / f"run_{k}", random, **fault)
        for k in range(REFERENCES):
            write(bags / f"healthy_{k}", random)
        case = {
            "rig": "pressure",
            "options": {"vacuum_pa": 50e3},
            "bags": [f"bags/run_{k}" for k in range(RUNS)],
            "references": [f"bags/healthy_{k}" for k in range(REFERENCES)],
        }
        (bags.parent / "case.json").write_text(json.dumps(case))
    key.write_text(json.dumps({"cases": {name: truth for name, (truth, _) in CASES.items()}}))


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
