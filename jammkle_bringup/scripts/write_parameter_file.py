"""Write config/ankle.yaml and config/robot.yaml anew from the nodes' parameter tables."""

from pathlib import Path

from jammkle_bringup.core.node_table import NODES, ROBOT_NODES
from jammkle_bringup.core.parameter_file import parameter_file_text

if __name__ == "__main__":
    folder = Path(__file__).resolve().parents[1] / "config"
    for name, nodes in (("ankle.yaml", NODES), ("robot.yaml", ROBOT_NODES)):
        (folder / name).write_text(parameter_file_text(nodes), encoding="utf-8")
