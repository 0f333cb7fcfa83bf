"""The viewer layout shows topics and fields that exist."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from jammkle_graph.bags.definitions import MessageDefinitions, share_folders
from jammkle_graph.names import TOPICS

LAYOUT = json.loads((Path(__file__).resolve().parents[1] / "config" / "ankle.foxglove.json").read_text())
PLOTS = {name: config for name, config in LAYOUT["configById"].items() if name.startswith("Plot!")}
PATHS = sorted(path["value"] for plot in PLOTS.values() for path in plot["paths"])


def panels(layout: Any) -> set[str]:
    return {layout} if isinstance(layout, str) else panels(layout["first"]) | panels(layout["second"])


@pytest.mark.parametrize("path", PATHS)
def test_a_plotted_path_exists(path: str) -> None:
    """A plot's path is a topic of the graph, then fields of its type."""
    topics = {f"/{topic.name.lstrip('/')}": topic for topic in TOPICS}
    name, _, fields = path.partition(".")
    kind = topics[name].message_type
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(MessageDefinitions(share_folders()).find(kind).text, kind))
    # without indices and filters
    for field in re.sub(r"\[[^]]*\]|\{[^}]*\}", "", fields).split("."):
        known = dict(store.fielddefs[kind][1])
        assert field in known, f"{kind} has no field {field}"
        inner = re.search(r"\w+/msg/\w+", str(known[field]))
        kind = inner.group() if inner else kind


def test_every_panel_has_its_place() -> None:
    """The panels that are configured are those that are shown."""
    assert panels(LAYOUT["layout"]) == set(LAYOUT["configById"])
