"""Make a release: version, changelog, commit and tag. `make release VERSION=0.2.0` builds its wheels afterwards."""

from __future__ import annotations

import datetime as dt
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
CHANGELOG = ROOT / "CHANGELOG.md"
VERSION_FILE = ROOT / "jammkle_common" / "jammkle_common" / "__init__.py"
UNRELEASED = "## Unreleased\n"


class ReleaseError(Exception):
    """Why there can be no release, in one line."""


def numbers(version: str) -> tuple[int, ...]:
    """Return the three numbers of a version.

    Raises:
        ReleaseError: it is not of the form 1.2.3.

    """
    if not re.fullmatch(r"\d+\.\d+\.\d+", version):
        msg = f"version '{version}' is not of the form 1.2.3 (Semantic Versioning): `make release VERSION=1.2.3`"
        raise ReleaseError(msg)
    return tuple(int(number) for number in version.split("."))


def released(changelog: str, version: str, day: dt.date) -> str:
    """Return the changelog with what is unreleased under a version, and nothing unreleased above it.

    Raises:
        ReleaseError: nothing is unreleased.

    """
    before, heading, after = changelog.partition(UNRELEASED)
    entries, _, older = after.partition("\n## ")
    if not heading or not re.search(r"^- ", entries, re.MULTILINE):
        msg = "CHANGELOG.md has nothing under 'Unreleased': there is nothing to release"
        raise ReleaseError(msg)
    rest = f"\n## {older}" if older else ""
    return f"{before}{UNRELEASED}\n## {version} - {day.isoformat()}\n{entries}{rest}"


def git(*arguments: str) -> str:
    """Run git in the checkout and return what it says."""
    return subprocess.run(["git", "-C", ROOT, *arguments], capture_output=True, text=True, check=True).stdout.strip()


def release(version: str) -> None:
    """Write, commit and tag.

    Raises:
        ReleaseError: the version is wrong, something is not committed, or there is nothing to release.

    """
    source = VERSION_FILE.read_text()
    present = re.search('VERSION = "(.*)"', source)[1]
    tags = git("tag", "--list", "v*").splitlines()
    if f"v{version}" in tags or numbers(version) < numbers(present):
        msg = f"version {version} is not newer than {', '.join([*tags, present])}"
        raise ReleaseError(msg)
    if git("status", "--porcelain"):
        msg = "there are changes that are not committed: commit or stash them first"
        raise ReleaseError(msg)
    CHANGELOG.write_text(released(CHANGELOG.read_text(), version, dt.datetime.now(dt.timezone.utc).date()))
    VERSION_FILE.write_text(source.replace(f'"{present}"', f'"{version}"'))
    subprocess.run([sys.executable, ROOT / "test" / "readme_tables.py"], check=True)
    git("commit", "--all", "--message", f"Release {version}")
    git("tag", "--annotate", f"v{version}", "--message", f"Jammkle {version}")


def main(arguments: list[str]) -> int:
    """Release the version that is named."""
    try:
        release(arguments[0] if arguments else "")
    except ReleaseError as error:
        sys.stderr.write(f"release: {error}\n")
        return 2
    sys.stdout.write(f"committed and tagged v{arguments[0]}; `git push --follow-tags` makes it public\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
