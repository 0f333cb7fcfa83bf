"""README and pages say what the code does, and every line of the command that they show is one."""

from __future__ import annotations

import ast
import importlib
import json
import re
import runpy
import shlex
from pathlib import Path

import pytest
from command_tree import subcommands
from shown import DOCUMENTS, blocks

from command_reference import NAME, parse
from readme_tables import DOCS, ROOT, made

SEPARATORS = {"&&", "||", ";", "&", "|", "(", ")"}
REDIRECTIONS = {">", ">>", ">&", "<"}


def lines_of(text: str) -> list[list[str]]:
    """Words of every call of the command in a shell script, without what the shell takes of it."""
    calls: list[list[str]] = []
    for line in re.sub(r"\$\([^()]*\)", "", text.replace("\\\n", " ")).splitlines():
        lexer = shlex.shlex(line, posix=True, punctuation_chars=True)
        lexer.whitespace_split = True
        calls.append([])
        taken = True
        for word in lexer:
            if word in SEPARATORS:
                calls.append([])
            taken = word in SEPARATORS or (taken and word not in REDIRECTIONS)
            if taken and word not in SEPARATORS:
                calls[-1].append(word)
    return [[NAME, *words[1:]] for words in calls if words and Path(words[0]).name == NAME]


def shown_calls() -> list[tuple[str, list[str]]]:
    """Every call of the command in a shell block of a document, with the document's name."""
    return [(block.page, words) for block in blocks("bash") for words in lines_of(block.text)]


def test_what_is_made_from_the_code_is_as_the_code_has_it() -> None:
    """Tables, reference and examples of the pages, and the firmware's registers; `make readme` writes them."""
    for path, text in made().items():
        assert path.read_text() == text, path.name


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: path.name)
def test_every_row_has_the_cells_of_its_head(path: Path) -> None:
    """No stray bar breaks a table where a document is shown."""
    width = 0
    for line in path.read_text().splitlines():
        cells = len(re.findall(r"(?<!\\)\|", line)) if line.startswith("|") else 0
        assert not (cells and width) or cells == width, line
        width = cells


def test_the_shell_is_read_as_a_shell_reads_it() -> None:
    """What the examples are cut into calls by knows comments, redirections, and what runs one after the other."""
    script = f"""
export PATH=x
.venv/bin/{NAME} up --speed 0 > up.log 2>&1 &   # started; and left alone
{NAME} gap diagnose a $(printf -- '--since %s ' b_*) \\
    -o "c d" && {NAME} info c
"""
    assert lines_of(script) == [
        [NAME, "up", "--speed", "0"],
        [NAME, "gap", "diagnose", "a", "-o", "c d"],
        [NAME, "info", "c"],
    ]


def test_every_verb_is_shown() -> None:
    """No verb is without an example."""
    shown = {words[1] for _, words in shown_calls()}
    assert {name.split()[0] for name in subcommands()} <= shown


@pytest.mark.parametrize("call", sorted({(name, shlex.join(words)) for name, words in shown_calls()}), ids=" ".join)
def test_a_call_that_is_shown_is_one(call: tuple[str, str]) -> None:
    """Verb and options of an example exist, and take what they are given."""
    parse(shlex.split(call[1]))


def test_a_call_that_is_none_is_noticed() -> None:
    """An option, a verb or a value that does not exist fails."""
    for words in (["jam", "--vacuum", "3"], ["rig", "drop", "--food", "jammed"], ["frob"], ["up", "--robot", "cat"]):
        with pytest.raises(Exception, match=r"[Nn]o such|no command|Invalid value|is not one of"):
            parse([NAME, *words])


def shown_imports() -> list[tuple[str, str, str]]:
    """Every name that Python on a page imports from the project: page, module, name."""
    return sorted(
        {
            (block.page, str(node.module), alias.name)
            for block in blocks("python")
            for node in ast.walk(ast.parse(block.text))
            if isinstance(node, ast.ImportFrom) and str(node.module).startswith("jammkle_")
            for alias in node.names
        }
    )


@pytest.mark.parametrize("shown", shown_imports(), ids=" ".join)
def test_python_that_is_shown_imports_what_there_is(shown: tuple[str, str, str]) -> None:
    """It is Python, and every name that it takes from the project is there."""
    _, module, name = shown
    assert hasattr(importlib.import_module(module), name)


def test_every_make_target_that_is_shown_exists() -> None:
    """Each `make NAME` of a document is a target of the Makefile."""
    makefile = (ROOT / "Makefile").read_text()
    for path in DOCUMENTS:
        for target in set(re.findall(r"(?:^|`)make ([a-z][a-z-]*)", path.read_text(), re.MULTILINE)):
            assert re.search(rf"^{target}:", makefile, re.MULTILINE), f"{path.name} shows make {target}"


def test_every_file_that_is_linked_exists() -> None:
    """Each relative link or picture of a document leads to a file of the project; `make docs` checks the headings."""
    for path in DOCUMENTS:
        for target in re.findall(r"\]\((?!https?://|#)([^)#]+)", path.read_text()):
            assert (path.parent / target).exists(), f"{path.name} links to {target}"


def test_the_readme_is_one_screen() -> None:
    """What it is, a picture, two commands, a first session, where to read on: the rest stands on the pages."""
    assert len((ROOT / "README.md").read_text().splitlines()) <= 60


def test_the_search_has_excerpts_without_a_server(tmp_path: Path) -> None:
    """The script of the search holds what each page says, without the navigation around it."""
    (tmp_path / "_static").mkdir()
    (tmp_path / "start.html").write_text("<nav>menu</nav><main><p>vacuum</p></main>", encoding="utf-8")
    runpy.run_path(str(DOCS / "conf.py"))["write_excerpts"](tmp_path, {"start"})
    script = (tmp_path / "_static" / "excerpts.js").read_text(encoding="utf-8")
    found = re.match(r"const PAGES = (.*);\n", script)
    assert found
    assert json.loads(found[1]) == {"start.html": "<main><p>vacuum</p></main>"}
    assert "</" not in script
