"""The directive `notebook`: a Jupyter notebook with the outputs that are in its file."""

from __future__ import annotations

import html
import json
from pathlib import Path

from docutils import nodes
from docutils.statemachine import StringList
from sphinx.util.docutils import SphinxDirective


def _picture(kind, data):
    source = f"data:{kind};base64,{''.join(data).strip()}"
    return f'<p><img class="output" alt="a figure of this cell" src="{html.escape(source)}"></p>'


def _outputs(cell):
    for output in cell["outputs"]:
        data = output.get("data", {})
        if "image/png" in data:
            yield nodes.raw("", _picture("image/png", data["image/png"]), format="html")
        elif text := "".join(output.get("text", data.get("text/plain", []))):
            block = nodes.literal_block("", text.rstrip("\n"), language="none")
            block["classes"].append("output")
            yield block


class Notebook(SphinxDirective):
    """The cells of a notebook: words as words, code as code with what it gave."""

    required_arguments = 1

    def run(self):
        """Read the notebook and turn it into nodes, its first heading left out."""
        file = (Path(self.env.srcdir) / self.arguments[0]).resolve()
        self.env.note_dependency(str(file))
        shown = nodes.container()
        for cell in json.loads(file.read_text(encoding="utf-8"))["cells"]:
            text = "".join(cell["source"])
            if cell["cell_type"] == "markdown":
                words = text.splitlines()
                words = words[1:] if words[0].startswith("# ") else words
                self.state.nested_parse(StringList(words, str(file)), 0, shown)
            else:
                shown += nodes.literal_block("", text, language="python")
                shown += list(_outputs(cell))
        return shown.children


def setup(app):
    """Make the directive known."""
    app.add_directive("notebook", Notebook)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
