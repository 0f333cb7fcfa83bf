"""Write config/ankle.yaml and config/robot.yaml anew from the nodes' parameter tables."""

from pathlib import Path

from jammkle_bringup.core.node_table import NODES, ROBOT_NODES, ROBOT_VALUES
from jammkle_bringup.core.parameter_file import parameter_file_text

if __name__ == "__main__":
    folder = Path(__file__).resolve().parents[1] / "config"
    for name, nodes, values in (("ankle.yaml", NODES, {}), ("robot.yaml", ROBOT_NODES, ROBOT_VALUES)):
        (folder / name).write_text(parameter_file_text(nodes, values), encoding="utf-8")
