"""Settings of the documentation. Build: python -m sphinx -q -W --keep-going docs build/docs"""

import re
from pathlib import Path

root = Path(__file__).parent.parent
project = "layerfit"
author = "The layerfit developers"
release = re.findall(r'__version__ = "(.*?)"', (root / "src/layerfit/__init__.py").read_text())[0]
extensions = ["myst_parser"]
html_theme = "furo"
html_title = f"layerfit {release}"
myst_heading_anchors = 3
myst_enable_extensions = ["dollarmath"]
suppress_warnings = ["myst.header"]
