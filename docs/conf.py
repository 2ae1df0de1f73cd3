"""Sphinx settings. The pages commands.md and configuration.md are made by reference.py and
committed.
"""

import sys
from pathlib import Path

from stereo_seecolor.version import __version__

sys.path.insert(0, str(Path(__file__).parent))  # mathml.py, sample_page.py

project = "stereo-seecolor"
author = "the stereo-seecolor authors"
release = __version__
extensions = ["myst_parser", "mathml", "sample_page", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
myst_enable_extensions = ["dollarmath", "amsmath", "colon_fence", "deflist"]
myst_heading_anchors = 3
html_theme = "furo"
html_title = f"stereo-seecolor {release}"
html_math_renderer = "mathml"
html_copy_source = False
html_static_path = ["static"]
html_css_files = ["pages.css"]
smartquotes_action = "qe"  # a double hyphen belongs to an option
exclude_patterns = ["_build", "_generated"]  # the second is left over in checkouts of 0.1.0
autodoc_member_order = "bysource"
napoleon_use_ivar = True  # fields are explained in the docstring of their class
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
python_maximum_signature_line_length = 100
