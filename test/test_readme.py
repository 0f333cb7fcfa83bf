"""The README says what the code does."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

from graph import COMMAND
from readme_tables import README, made

ROOT = README.parent


def test_the_tables_are_those_of_the_code() -> None:
    """Tables of the documents and the firmware's registers are as the code has them; `make readme` writes them."""
    for path, text in made().items():
        assert path.read_text() == text, path.name


def test_every_row_has_the_cells_of_its_head() -> None:
    """No stray bar breaks a table where the README is shown."""
    width = 0
    for line in README.read_text().splitlines():
        cells = len(re.findall(r"(?<!\\)\|", line)) if line.startswith("|") else 0
        assert not (cells and width) or cells == width, line
        width = cells


def test_every_subcommand_that_is_shown_exists() -> None:
    """Each `jammkle NAME` of the README's code blocks answers `--help`."""
    blocks = re.findall(r"```bash\n(.*?)```", README.read_text(), re.DOTALL)
    names = sorted(set(re.findall(r"(?:^|[ /])jammkle ([a-z]+)", "\n".join(blocks), re.MULTILINE)))
    assert {"info", "jam", "record", "status", "unjam", "up"} <= set(names)
    for name in names:
        help_text = subprocess.run([COMMAND, name, "--help"], capture_output=True, text=True, check=True).stdout
        assert "Usage" in help_text


def test_every_make_target_that_is_shown_exists() -> None:
    """Each `make NAME` of the README and of CONTRIBUTING.md is a target of the Makefile."""
    makefile = (ROOT / "Makefile").read_text()
    for name in ("README.md", "CONTRIBUTING.md"):
        for target in set(re.findall(r"(?:^|`)make ([a-z-]+)", (ROOT / name).read_text(), re.MULTILINE)):
            assert re.search(rf"^{target}:", makefile, re.MULTILINE), f"{name} shows make {target}"


def test_every_file_that_is_linked_exists() -> None:
    """Each relative link of the documents leads to a file of the project."""
    for document in ROOT.glob("*.md"):
        for target in re.findall(r"\]\((?!https?://|#)([^)#]+)", document.read_text()):
            assert (ROOT / Path(target)).exists(), f"{document.name} links to {target}"
