"""A rig is one file and one place where it is registered: that of CONTRIBUTING.md, added to a copy of the package."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import jammkle_sim

PAGE = Path(jammkle_sim.__file__).resolve().parents[2] / "CONTRIBUTING.md"
VERB = "from jammkle_sim.commands.rig import rig; import sys; sys.exit(rig(sys.argv[1:]))"


def test_a_rig_of_one_file_is_there(tmp_path: Path) -> None:
    """It is listed with its options, runs, writes a bag, and says what it measured."""
    (text,) = re.findall(r"<!-- a rig that a test adds -->\n```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    package = tmp_path / "jammkle_sim"
    shutil.copytree(Path(jammkle_sim.__file__).parent, package)  # with what is compiled already
    (package / "rigs" / "hanging.py").write_text(text)
    catalogue = package / "rigs" / "catalogue.py"
    registered = catalogue.read_text().replace(" drop, landing", " drop, hanging, landing")
    catalogue.write_text(registered.replace("landing.RIG)", "landing.RIG, hanging.RIG)"))

    def rig(*arguments: str) -> str:
        path = os.pathsep.join(filter(None, (str(tmp_path), os.environ.get("PYTHONPATH"))))
        environment = {**os.environ, "PYTHONPATH": path, "COLUMNS": "120", "TERM": "dumb"}
        command = [sys.executable, "-c", VERB, *arguments]
        return subprocess.check_output(command, env=environment, cwd=tmp_path, text=True)

    assert "Let an ankle hang" in rig("--help")
    assert "--duration-s" in rig("hanging", "--help")
    rig("hanging", "-o", str(tmp_path / "bag"), "--json", str(tmp_path / "run.json"))
    (run,) = json.loads((tmp_path / "run.json").read_text())["runs"]
    assert abs(run["results"]["final_pitch_rad"]) < 0.1
    assert list((tmp_path / "bag").glob("*.mcap"))
