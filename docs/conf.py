# SPDX-License-Identifier: MIT
"""How the site is built from these pages and from docstrings: `make docs`; the source is the whole checkout.

Pages link to one another by relative paths, as they do on any host of the repository; strict, so that a link
to nothing ends the build. Fonts are the system's, search is in the pages: the site works from its folder.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

project = "unseen"
extensions = ["myst_parser", "sphinx.ext.autodoc", "numpydoc"]
include_patterns = ["docs/**.md", "*.md"]
root_doc = "docs/index"
nitpicky = True
default_role = "code"  # docstrings set names in single backticks

myst_heading_anchors = 4
myst_enable_extensions = ["colon_fence"]

autodoc_typehints = "none"  # docstrings say types with shapes and units
autodoc_preserve_defaults = True
autodoc_default_options = {"members": True, "member-order": "bysource"}
numpydoc_show_class_members = False  # the methods follow, each with its own text
python_maximum_signature_line_length = 88

html_theme = "furo"
html_title = "unseen"
html_extra_path = ["site"]
html_copy_source = False
html_show_sourcelink = False
