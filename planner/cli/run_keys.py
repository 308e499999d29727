"""Every key of a run file: its kind, its default, and what it is for."""

from __future__ import annotations

from planner.cli.planning import IGNORED
from planner.cli.run_keys_output import EXPORT, OUTPUT
from planner.cli.run_keys_robot import LEG, MODELS, PATHS
from planner.files.kinds import choice, flag, number, several, span, text, whole
from planner.files.schema import Key, Table

TOP = Table(
    name=(),
    about="Where the results go.",
    keys=(
        Key(
            name="out",
            kind=text("the name of a folder"),
            about="Folder of the results; --out overrules it.",
            otherwise="the name of this file without its ending",
            example="results",
        ),
    ),
)

PLAN = (
    Table(
        name=("plan",),
        about="How the requests are found.",
        keys=(
            Key(
                name="method",
                kind=choice(*IGNORED),
                about="The paper's inversion, or optimised joint by joint, or all for the foot.",
                default="optimal",
                set_to="foot-optimal",
            ),
            Key(
                name="cyclic",
                kind=flag(),
                about="Whether the path repeats for ever, or starts from rest.",
                default=True,
            ),
            Key(
                name="norm",
                kind=choice("rms", "max"),
                about="Methods optimal and foot-optimal: the error to make small.",
                otherwise='"rms"',
                example="rms",
            ),
            Key(
                name="solver",
                kind=choice("gauss-newton", "ipopt", "fatrop"),
                about="Method optimal: our own solver, or one of CasADi's.",
                otherwise='"gauss-newton"',
                example="gauss-newton",
            ),
            Key(
                name="weights",
                kind=several(number(least=0.0), "three numbers, 0 or more", count=3),
                about="Method foot-optimal: how much each axis counts, x, y, z.",
                otherwise="[1.0, 1.0, 1.0]",
                example=[1.0, 1.0, 1.0],
            ),
            Key(
                name="segments",
                kind=whole(least=1, most=10**6),
                about="Method closed-form: lines of the approximation.",
                otherwise="as many as pay off",
                example=6,
            ),
            Key(
                name="rule",
                kind=choice("paper", "exact"),
                about="Method closed-form: how a line is inverted.",
                otherwise='"paper"',
                example="paper",
            ),
        ),
    ),
    Table(
        name=("limits",),
        about="Ranges of the requests; those of the leg hold where there are none.",
        keys=(
            Key(
                name="deg",
                kind=span(),
                about="Smallest and largest request of every joint [deg].",
                otherwise="those of the leg, if there is one",
                example=[-120.0, 150.0],
            ),
        ),
    ),
    Table(
        name=("limits", "joints"),
        about="The same for single joints [deg], which have the last word.",
        free=span(),
        example=[-27.0, 147.0],
        wanted=False,
    ),
    Table(
        name=("start",),
        about="With plan.cyclic = false and method optimal: where the joints rest before.",
        keys=(
            Key(
                name="deg",
                kind=number(),
                about="Angle of every joint [deg].",
                otherwise="where the path begins",
                example=0.0,
            ),
        ),
    ),
    Table(
        name=("start", "joints"),
        about="The same for single joints [deg], which have the last word.",
        free=number(),
        example=30.0,
        wanted=False,
    ),
    Table(
        name=("tolerance",),
        about="Errors to accept; a plan that misses them is written, and the exit status is 1.",
        keys=(
            Key(
                name="deg",
                kind=number(above=0.0),
                about="Of any joint, in the plan's norm [deg]; not with method foot-optimal.",
                example=10.0,
            ),
            Key(
                name="cm",
                kind=number(above=0.0),
                about="Of the foot, in the plan's norm [cm].",
                example=1.0,
                set_to=1.0,
            ),
        ),
    ),
)

RUN = (TOP, LEG, *MODELS, *PATHS, *PLAN, OUTPUT, EXPORT)
"""The tables of a run file, in the order of the template."""
