"""The directive `commands`: what `request-planner COMMAND --help` says, a section each."""

from __future__ import annotations

from docutils import nodes
from sphinx.util.docutils import SphinxDirective

from planner.cli import cli

WIDTH = 88


PROGRAM = "request-planner"


def _helps():
    """The program and each of its commands: what to call it, and its help."""
    with cli.make_context(PROGRAM, [], resilient_parsing=True) as program:
        yield PROGRAM, cli, program
        for name in cli.list_commands(program):
            command = cli.get_command(program, name)
            yield name, command, program


def _section(name, command, program):
    settings = {"max_content_width": WIDTH, "terminal_width": WIDTH, "resilient_parsing": True}
    parent = None if command is cli else program
    with command.make_context(name, [], parent=parent, **settings) as context:
        text = command.get_help(context)
    section = nodes.section(ids=[nodes.make_id(name)], names=[name])
    section += nodes.title("", name)
    section += nodes.literal_block("", text, language="none")
    return section


class Commands(SphinxDirective):
    """A section of help for the program and for each of its commands."""

    def run(self):
        """Ask click, and hand over what it prints."""
        sections = [_section(*each) for each in _helps()]
        for section in sections:
            self.state.document.note_explicit_target(section)
        return sections


def setup(app):
    """Make the directive known."""
    app.add_directive("commands", Commands)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
