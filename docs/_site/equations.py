"""Numbers of equations lead to them: "(9)" on the page that has them, "equation (9)" on others."""

from __future__ import annotations

import re

from docutils import nodes
from mathml import anchor_of, tag_of
from sphinx.util import logging
from sphinx.util.nodes import make_refnode

HOME = "math"
"""The page with the numbered equations."""

HERE = re.compile(r"\((\d+[a-z]?)\)")
ELSEWHERE = re.compile(r"(?<=[Ee]quation )\((\d+[a-z]?)\)")
NO_PROSE = (nodes.literal, nodes.literal_block, nodes.math, nodes.math_block, nodes.reference)

LOG = logging.getLogger(__name__)


def _link(app, tree, page):
    known = {tag_of(node) for node in app.env.get_doctree(HOME).findall(nodes.math_block)}
    pattern = HERE if page == HOME else ELSEWHERE
    for text in list(tree.findall(nodes.Text)):
        if isinstance(text.parent, NO_PROSE) or not pattern.search(text):
            continue
        pieces, end = [], 0
        for found in pattern.finditer(text):
            if found[1] not in known:
                LOG.warning("no equation has the number %s", found[0], location=text.parent)
                continue
            pieces.append(nodes.Text(text[end : found.start()]))
            place, shown = anchor_of(found[1]), nodes.Text(found[0])
            pieces.append(make_refnode(app.builder, page, HOME, place, shown))
            end = found.end()
        text.parent.replace(text, [*pieces, nodes.Text(text[end:])])


def setup(app):
    """Link once all pages are read."""
    app.connect("doctree-resolved", _link)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
