"""Templates to HTML: one environment for all, and figures as pictures within the page."""

from __future__ import annotations

import base64
import importlib.resources
import io
from typing import TYPE_CHECKING, Any

import jinja2
from markupsafe import Markup

from jammkle_gap.report import words

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TEXT: dict[Any, Any] = {"svg.fonttype": "none", "font.family": "sans-serif", "svg.hashsalt": "jammkle gap"}
"""Style of text in figures: as text, the same bytes for the same picture."""


def rendered(package: str | None, template: str, **values: Any) -> Markup:
    """Return a template as HTML.

    Args:
        package: Where it lies; that of the module that calls.
        template: Its file.
        values: What it shows; a value that it names and that is not given is an error.

    """
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["label"] = words.label
    source = importlib.resources.files(package or __package__).joinpath(template).read_text(encoding="utf-8")
    return Markup(environment.from_string(source).render(**values))  # noqa: S704 - escaped by the environment


def embedded(figure: Figure) -> Markup:
    """Return a figure as an address that holds the whole picture: the page needs no network and no second file."""
    file = io.StringIO()
    figure.savefig(file, format="svg", metadata={"Date": None, "Creator": None})
    data = base64.b64encode(file.getvalue().encode()).decode()
    return Markup("data:image/svg+xml;base64,{}").format(data)
