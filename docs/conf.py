"""How Sphinx builds the pages: `make docs`."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterable

ROOT = Path(__file__).resolve().parents[1]

project = "Jammkle"
author = "Jammkle maintainers"
version = release = re.search('VERSION = "(.*)"', (ROOT / "jammkle_common/jammkle_common/__init__.py").read_text())[1]
html_title = f"Jammkle {version}"

extensions = ["myst_parser"]
exclude_patterns = ["_build", "examples"]
nitpicky = True

myst_heading_anchors = 4
myst_links_external_new_tab = False

html_theme = "sphinx_book_theme"
html_theme_options = {"home_page_in_toc": True, "navbar_persistent": [], "use_download_button": False}
html_static_path = ["static"]
html_css_files = ["wide.css"]
html_copy_source = False
html_show_copyright = False

_INTERFACES = {"Messages": "msg", "Services": "srv"}
_EXCERPTS = "excerpts.js"
_FETCH = """
const fetchFromServer = window.fetch;
window.fetch = (address, ...options) => {
  const page = String(address).split("/").pop();
  if (location.protocol !== "file:" || !(page in PAGES)) return fetchFromServer(address, ...options);
  return Promise.resolve(new Response(PAGES[page]));
};
"""


def interfaces() -> str:
    """Every message and service of the project, as its file has it."""
    parts = []
    for title, folder in _INTERFACES.items():
        parts.append(f"## {title}")
        parts.extend(
            f"### {path.stem}\n\n```text\n{path.read_text(encoding='utf-8')}```"
            for path in sorted((ROOT / "jammkle_msgs" / folder).iterdir())
        )
    return "\n\n".join(parts)


def write_excerpts(built: Path, pages: Iterable[str]) -> None:
    """Write the pages' text into a script of the search: a browser fetches no page from a disk."""
    texts = {}
    for page in sorted(pages):
        html = (built / f"{page}.html").read_text(encoding="utf-8")
        main = re.search(r"<main\b.*?</main>", html, re.DOTALL)
        if main:
            texts[f"{page}.html"] = main[0]
    script = f"const PAGES = {json.dumps(texts)};\n{_FETCH}"
    (built / "_static" / _EXCERPTS).write_text(script.replace("</", "<\\/"), encoding="utf-8")


def setup(app: Any) -> dict[str, bool]:
    """Add the interfaces to their page, and excerpts of the pages to the results of the search."""

    def define(_: object, page: str, text: list[str]) -> None:
        if page == "interfaces":
            text[0] += interfaces()

    def add(app: Any, page: str, *_: object) -> None:
        if page == "search":
            app.add_js_file(_EXCERPTS)

    def finish(app: Any, error: Exception | None) -> None:
        if error is None and app.builder.format == "html":
            write_excerpts(Path(app.outdir), app.env.found_docs)

    app.connect("source-read", define)
    app.connect("html-page-context", add)
    app.connect("build-finished", finish)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
