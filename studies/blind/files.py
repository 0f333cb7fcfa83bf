"""Files of a trial: `trial.json` and `case.json`, which may tell nothing of the answers. See `README.md`.

TRIAL/
    trial.json               what the trial is, and the hash of its key
    cases/0001/case.json     which bags are to be diagnosed, which are references
    cases/0001/bags/...      the bags
    answers/RUN/0001.json    what the diagnosis said, one folder per way of asking
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from jammkle_common.command.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

FORMAT = 1
TRIAL_NAME, CASE_NAME, CASES, BAGS, ANSWERS = "trial.json", "case.json", "cases", "bags", "answers"


@dataclass(frozen=True)
class TrialFacts:
    """What everybody may know of a trial."""

    key_sha256: str
    """Hash of the key's file, published before anything is diagnosed."""
    seed: int | None = None
    """That everything was drawn from, where it was."""
    commit: str = ""
    """Of the program that made it."""
    regimes: str = ""
    """How the rigs were set: `development`, `held out`, or what the maker calls it."""


@dataclass(frozen=True)
class CaseNote:
    """What a lab hands over with the bags of one case."""

    bags: tuple[str, ...]
    """To be diagnosed; paths relative to the case's folder."""
    references: tuple[str, ...] = ()
    """Of the same machine while healthy."""
    rig: str | None = None
    """What was recorded, where the bags do not tell."""
    options: Mapping[str, Any] = field(default_factory=dict)
    """How it was set, where the bags do not tell."""


def write_trial(folder: Path, facts: TrialFacts) -> None:
    """Write `trial.json`."""
    content = {
        "format": FORMAT,
        "key_sha256": facts.key_sha256,
        "seed": facts.seed,
        "commit": facts.commit,
        "regimes": facts.regimes,
    }
    write_json(folder / TRIAL_NAME, content)


def read_trial(folder: Path) -> TrialFacts:
    """Read `trial.json`.

    Raises:
        InputError: there is none, or it is not what it should be.

    """
    content = read_json(folder / TRIAL_NAME, "trial", "make one with `python -m studies.blind make`")
    sha256 = content.get("key_sha256")
    if not isinstance(sha256, str) or len(sha256) != 64:  # noqa: PLR2004 - digits of a SHA-256
        msg = f"{folder / TRIAL_NAME} has no key_sha256 of 64 digits; publish the hash of the key's file there"
        raise InputError(msg)
    seed = content.get("seed")
    return TrialFacts(
        sha256.lower(),
        int(seed) if seed is not None else None,
        str(content.get("commit") or ""),
        str(content.get("regimes") or ""),
    )


def write_case(folder: Path, note: CaseNote) -> None:
    """Write `case.json`."""
    content: dict[str, Any] = {"format": FORMAT, "bags": list(note.bags), "references": list(note.references)}
    if note.rig is not None:
        content["rig"] = note.rig
    if note.options:
        content["options"] = dict(note.options)
    write_json(folder / CASE_NAME, content)


def read_case(folder: Path) -> CaseNote:
    """Read `case.json`.

    Raises:
        InputError: there is none, it is not what it should be, or a bag is missing.

    """
    file = folder / CASE_NAME
    content = read_json(file, "case", "see README.md")
    bags, references = content.get("bags"), content.get("references") or []
    if not isinstance(bags, list) or not bags or not isinstance(references, list):
        msg = f"{file} must list bags to diagnose under 'bags', and may list 'references'"
        raise InputError(msg)
    for bag in (*bags, *references):
        if not (folder / str(bag)).exists():
            msg = f"{file} names bag '{bag}', which is not there; paths are relative to {folder}"
            raise InputError(msg)
    rig, options = content.get("rig"), content.get("options") or {}
    if not isinstance(options, dict):
        msg = f"{file} has options that are no table of NAME: value"
        raise InputError(msg)
    return CaseNote(tuple(map(str, bags)), tuple(map(str, references)), None if rig is None else str(rig), options)


def case_names(folder: Path) -> tuple[str, ...]:
    """Return the names of a trial's cases, sorted.

    Raises:
        InputError: there are none.

    """
    names = sorted(file.parent.name for file in (folder / CASES).glob(f"*/{CASE_NAME}"))
    if not names:
        msg = f"trial {folder} has no cases: nothing matches {CASES}/*/{CASE_NAME}"
        raise InputError(msg)
    return tuple(names)


def answer_file(folder: Path, run: str, case: str) -> Path:
    """Return where an answer is kept."""
    return folder / ANSWERS / run / f"{case}.json"


def write_json(file: Path, content: Mapping[str, Any]) -> None:
    """Write JSON in one go: a reader sees all of it or nothing.

    Raises:
        InputError: it cannot be written.

    """
    part = file.with_name(f".{file.name}.part")
    try:
        part.write_text(json.dumps(content, indent=2, allow_nan=False) + "\n", encoding="utf-8")
        part.replace(file)
    except OSError as error:
        msg = f"{file} cannot be written: {error.strerror}"
        raise InputError(msg) from error


def read_json(file: Path, what: str, advice: str) -> dict[str, Any]:
    """Read a table in JSON.

    Raises:
        InputError: it cannot be read, is no table, or of another format.

    """
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        msg = f"{what} {file} cannot be read: {error.strerror}; {advice}"
        raise InputError(msg) from error
    except ValueError as error:
        msg = f"{what} {file} is not JSON: {error}; {advice}"
        raise InputError(msg) from error
    if not isinstance(content, dict):
        msg = f"{what} {file} is no table; {advice}"
        raise InputError(msg)
    if content.get("format", FORMAT) != FORMAT:
        msg = f"{what} {file} has format {content['format']}; this program knows {FORMAT}"
        raise InputError(msg)
    return content
