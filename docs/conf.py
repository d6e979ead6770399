"""Configuration of the documentation site: `make docs` builds it without network.

Sources are the Markdown files of the whole repository, so that links that lead to a page, to README or to an example
work both in the repository and on the site.
"""

import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
sys.path[:0] = [str(ROOT), str(HERE / "site")]

from eightpost import __version__  # noqa: E402

project = "eightpost"
author = "the eightpost developers"
copyright = "the eightpost developers; MIT licence"
version = release = __version__

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
    "sphinx_design",
    "docstrings",
    "equations",
    "gallery",
    "repository",
]

# ---- Sources ---------------------------------------------------------------------------------------------------------

root_doc = "docs/index"
include_patterns = [
    "docs/**.md", "README.md", "CONTRIBUTING.md", "CHANGELOG.md", "fmus/*/README.md", "fmus/common/shock.md",
    "examples/notebooks/*.ipynb",
]  # fmt: skip
exclude_patterns = ["out", ".venv", "build", "dist", "demo", "tests", "benchmarks", ".git", "**/.ipynb_checkpoints"]
source_suffix = {".md": "myst-nb", ".ipynb": "myst-nb"}

# ---- Markdown --------------------------------------------------------------------------------------------------------

myst_enable_extensions = ["dollarmath", "colon_fence"]
myst_fence_as_directive = ["math"]
myst_heading_anchors = 5
myst_dmath_double_inline = False
# Tests run the notebooks; the site shows what is stored in them.
nb_execution_mode = "off"
nb_ipywidgets_js = {}  # scripts of widgets would come from a network
# fmus/common/shock.md is also a part of other documents, where its headings are of the second level.
suppress_warnings = ["myst.header"]

# ---- Reference -------------------------------------------------------------------------------------------------------

default_role = "code"
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_preserve_defaults = True
autodoc_default_options = {"members": True}
napoleon_numpy_docstring = False
napoleon_google_docstring = True
napoleon_use_ivar = True
python_maximum_signature_line_length = 90
add_module_names = False

# ---- Pages -----------------------------------------------------------------------------------------------------------

html_theme = "pydata_sphinx_theme"
html_title = "eightpost"
smartquotes = False  # options begin with two hyphens
html_static_path = ["site/static"]
templates_path = ["site/templates"]
html_css_files = ["eightpost.css"]
html_search_scorer = str(HERE / "site" / "search_order.js")
html_context = {"default_mode": "auto"}
html_copy_source = False
html_show_sourcelink = False
html_math_renderer = "mathml"
# Pages without a section of their own have no list of it.
html_sidebars = {name: [] for name in ("docs/index", "docs/gallery", "docs/notebooks/index")}
html_theme_options = {
    "logo": {"text": "eightpost"},
    "navbar_align": "left",
    "header_links_before_dropdown": 8,
    "navbar_end": ["theme-switcher"],
    "show_nav_level": 1,
    "show_toc_level": 2,
    "collapse_navigation": True,
    "navigation_depth": 3,
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": ["copyright"],
    "footer_end": [],
    "pygments_light_style": "a11y-high-contrast-light",
    "pygments_dark_style": "a11y-high-contrast-dark",
}
copybutton_exclude = ".linenos, .gp, .go"
