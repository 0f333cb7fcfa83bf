"""Which commit this program is of."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path


def commit() -> str:
    """Return the commit of this program, with a + if files differ from it; empty where it is not known."""
    git = shutil.which("git")
    if git is None:
        return ""
    here = str(Path(__file__).resolve().parent)
    found = [
        subprocess.run([git, "-C", here, *words], capture_output=True, text=True, check=False)  # noqa: S603
        for words in (("rev-parse", "HEAD"), ("status", "--porcelain", "--untracked-files=no"))
    ]
    if found[0].returncode:
        return ""
    return found[0].stdout.strip() + ("+" if found[1].stdout.strip() else "")
