"""How Sphinx builds the pages: `make docs`."""

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]

project = "Jammkle"
author = "Jammkle maintainers"
version = release = re.search('VERSION = "(.*)"', (ROOT / "jammkle_msgs/jammkle_graph/version.py").read_text())[1]
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
