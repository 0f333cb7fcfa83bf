"""Write config/ankle.yaml anew from the nodes' parameter tables: `.venv/bin/python` with this file."""

from pathlib import Path

from jammkle_bringup.core.node_table import NODES
from jammkle_bringup.core.parameter_file import parameter_file_text

if __name__ == "__main__":
    target = Path(__file__).resolve().parents[1] / "config" / "ankle.yaml"
    target.write_text(parameter_file_text(NODES), encoding="utf-8")
