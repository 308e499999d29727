"""How the site is made; `scripts/docs` makes it."""

import sys
from pathlib import Path

from planner import __version__

sys.path.insert(0, str(Path(__file__).parent / "_site"))

project = "request-planner"
author = "The request-planner developers"
project_copyright = "The request-planner developers"
release = version = __version__
language = "en"

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.viewcode",
    "mathml",
    "equations",
    "commands",
    "charts",
    "gallery",
    "docstrings",
    "notebook",
]
root_doc = "index"
exclude_patterns = ["_site"]
nitpicky = True
nitpick_ignore_regex = [
    ("py:class", r"numpy\..*"),  # not of this project, and not to be had without a network
    (
        "py:class",
        r"(np|npt|os|pathlib)\..*|Path|Array(Like)?|Indices|Level|Norm|Solver|Topic"
        r"|Desired|Send|Models|ModelOrModels|JointLimits|LoadOfPose|Robust|Rule|Scenarios|Mask|Expectation"
        r"|Track|Retime|Progress|Method|planner\.learning\.refine\.AnyPlan"
        r"|(planner\.planning\.task\.)?Task|planner\.planning\.plan\.RequestMotion"
        r"|planner\.recording\.(retiming\.(Impossible|SpeedErrors)|recorded_path\.RecordedPath)"
        r"|Written|planner\.recording\.replaying\.JointReplay|TypeAliasForwardRef"
        r"|(planner\.planning\.plan\.)?ErrorsOfModels|PathSpeeds|tuple\[float"
        r"|planner\.robot\.(arm\.(Measured|Numbers)|bus\.Port|protocols\.ServoProtocol)"
        r"|planner\.virtual\.(motors\.Motor|servo_bus\.Kind)",
    ),  # the same, or aliases, or parts of an answer that its own docstring describes
    (
        "py:(mod|func|data|class)",
        r"(kinematics\.|planner$|collections).*",
    ),  # no public name
    ("py:(func|class)", r"planner\.(model|files|evaluation)\..*"),
]

html_theme = "furo"
html_title = "request-planner"
html_static_path = ["_site/static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sphinx = False
html_show_search_summary = False  # it would ask for the pages' sources
html_math_renderer = "mathml"
html_theme_options = {
    "light_css_variables": {
        "color-brand-primary": "#0b5fa5",
        "color-brand-content": "#0b5fa5",
    },
    "dark_css_variables": {
        "color-brand-primary": "#7cc0ff",
        "color-brand-content": "#7cc0ff",
    },
}
pygments_style = "friendly"
pygments_dark_style = "monokai"

myst_enable_extensions = ["dollarmath", "colon_fence", "attrs_block"]
myst_fence_as_directive = ["math"]
myst_heading_anchors = 3

autodoc_default_options = {"members": True, "inherited-members": "Exception, tuple"}
autodoc_preserve_defaults = True
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_type_aliases = {"npt.ArrayLike": "ArrayLike", "Array": "Array"}
python_maximum_signature_line_length = 80
add_module_names = False
