"""Settings of the documentation. Build: python -m sphinx -q -W --keep-going docs build/docs"""

import re
import sys
from pathlib import Path

root = Path(__file__).parent.parent
sys.path.insert(0, str(root / "docs"))

project = "layerfit"
author = "The layerfit developers"
project_copyright = f"2026 {author}"
release = re.findall(r'__version__ = "(.*?)"', (root / "src/layerfit/__init__.py").read_text())[0]
extensions = ["myst_parser", "sphinx.ext.autodoc", "mathml", "plain_docstrings"]
html_theme = "furo"
html_title = f"layerfit {release}"
html_static_path = ["_static"]
html_css_files = ["layerfit.css"]
html_math_renderer = "mathml"
html_copy_source = False
myst_heading_anchors = 3
myst_enable_extensions = ["dollarmath"]
autodoc_typehints = "none"
autodoc_member_order = "bysource"
add_module_names = False
highlight_language = "none"
