"""The documentation as a site: `make docs` builds it into site/, without any network, and checks links and examples."""

from __future__ import annotations

import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "_site"))

from mesotap import __version__  # noqa: E402

project = "mesotap"
author = "the mesotap authors"
copyright = author  # noqa: A001 - Sphinx wants this name
release = version = __version__

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "generated"]
exclude_patterns = ["_site"]

# notebooks are stored without results and executed at each build, in a folder of their own; a cell that fails ends it
nb_execution_mode = "force"
nb_execution_in_temp = True
nb_execution_raise_on_error = True
nb_execution_timeout = 600  # s a cell, of a machine that has other work
nb_execution_show_tb = True
nb_merge_streams = True
nb_ipywidgets_js = {}  # it would be fetched from elsewhere
html_theme = "furo"
html_title = f"mesotap {release}"
html_static_path = ["_site/site.css"]
html_css_files = ["site.css"]
html_show_sphinx = False
html_copy_source = False

myst_heading_anchors = 4
suppress_warnings = ["misc.highlighting_failure"]
highlight_language = "none"  # blocks that are only indented are commands or output

autodoc_typehints = "signature"
autodoc_typehints_format = "short"
python_use_unqualified_type_names = True
maximum_signature_line_length = 90
autodoc_member_order = "bysource"
autodoc_default_options = {"members": True}
autodoc_preserve_defaults = True
napoleon_google_docstring = False
napoleon_use_ivar = True
napoleon_use_rtype = False
default_role = "code"  # names in docstrings stand between single backquotes
