"""``request-planner excite``: test signals from which a joint can be identified."""

from __future__ import annotations

import math
from typing import Any

import click

from planner.cli import options
from planner.cli.console import Answer
from planner.cli.settings import Run

KINDS = ("combined", "steps", "multisine", "chirp", "random-steps", "triangle", "slow-triangle")

UNNAMED = "requested"  # the joint of a signal without a name, whose column is requested_deg


@click.command()
@options.option(
    "--kind",
    "A slow triangle, sines and steps in one recording, or one signal of its own; steps are "
    "the tests of Equation 1.",
    click.Choice(KINDS),
    default="combined",
)
@options.option("--limits-deg limits_deg", "Range of the requests.", options.SPAN, required=True)
@options.option(
    "--centre-deg", "Where the signal begins and ends.  [default: the middle of the limits]", float
)
@options.positive("--rate-hz", "Requests per second.  [default: those of the expected model]")
@options.option(
    "--duration-s",
    "Length of the signal, rests included.  [default: 60 for combined, else 20]",
    float,
)
@options.option(
    "--amplitude-deg",
    "Height of a step test. Repeat the option for several.  [default: an eighth, half and the "
    "whole of the range]",
    float,
    multiple=True,
)
@options.option(
    "--cycles", "Cycles of each step test.  [default: 3; 1 in each half of combined]", int
)
@options.option(
    "--highest-hz",
    "Highest frequency of sines and chirp.  [default: a tenth of the rate, at most 5]",
    float,
)
@options.option(
    "--seed", "Another number draws other random steps and noise.", click.IntRange(min=0), default=0
)
@options.option("--joint", "Name of the joint, for the column.", metavar="NAME", default=UNNAMED)
@options.settings("model: file")
@options.option(
    "--noise-deg", "Expected noise of the measured angles, standard deviation.", float, default=0.2
)
@options.option("--resolution-deg", "Expected resolution of the sensor.", float, default=0.3)
@options.option(
    "--expected-log",
    "Also write the log of a simulated joint, as an input for identify.",
    options.OUTPUT,
)
@options.output
@options.answers()
def excite(*, run: Run, joint: str, expected_log: str | None, **choices: Any) -> Answer:
    """Write test requests within limits, and print which parameters they determine.

    Move the joint slowly to the centre, play the requests one by one at their times, and record
    t_s, requested_deg and actual_deg right after each. The expected intervals come from simulating
    the joint of --model, with noise, and identifying it again.

    \b
    Example, a minute within 45 degrees either way, and a joint that is like the Aibo's:
        request-planner excite --limits-deg -45:45 -o test.csv --expected-log log.csv
    Steps of random height at 50 Hz for a joint that was identified before:
        request-planner excite --kind random-steps --limits-deg -60:30 --rate-hz 50 \\
            --model joint.toml --joint elbow -o elbow.csv
    """  # noqa: D301
    import numpy as np

    from planner.cli.desired import models_of
    from planner.files.paths import write_joint_path
    from planner.files.table import table_text
    from planner.identification.excitation import excite as make
    from planner.identification.excitation import expect
    from planner.report.identification_text import excitation_results, excitation_text

    kind, (low, high), turns = choices["kind"], choices["limits_deg"], 720.0
    if high - low > turns:
        raise click.UsageError(
            f"--limits-deg: got {low:g}:{high:g}, expected at most {turns:g} degrees from one to "
            "the other, two turns; are they counts of a sensor?"
        )
    for name, kinds in (
        ("amplitude_deg", ("combined", "steps")),
        ("cycles", ("combined", "steps")),
        ("highest_hz", ("combined", "multisine", "chirp")),
    ):
        if choices[name] not in (None, ()) and kind not in kinds:
            option = f"--{name.replace('_', '-')}"
            raise click.UsageError(f"{option} has no effect with --kind {kind}.")
    step, finest = choices["resolution_deg"], 1e-9  # a turn of 38 bits: more than any sensor has
    if 0.0 < step < finest:
        raise click.UsageError(
            f"--resolution-deg: got {step:g}, expected 0 for none, or at least {finest:g}."
        )
    (model,) = models_of(run, [joint])
    centre, rate, duration = (choices[name] for name in ("centre_deg", "rate_hz", "duration_s"))
    usual = 60.0 if kind == "combined" else 20.0
    excitation = make(
        kind.replace("-", "_"),
        limits=(math.radians(low), math.radians(high)),
        period=model.period if rate is None else 1.0 / rate,
        duration=usual if duration is None else duration,
        centre=None if centre is None else math.radians(centre),
        amplitudes=[math.radians(height) for height in choices["amplitude_deg"]] or None,
        cycles=choices["cycles"],
        highest=choices["highest_hz"],
        seed=choices["seed"],
    )
    expected = expect(
        excitation,
        model,
        noise=math.radians(choices["noise_deg"]),
        resolution=math.radians(choices["resolution_deg"]),
        seed=choices["seed"],
    )
    (fit,) = expected.fits
    prefix, log = "" if joint == UNNAMED else f"{joint}_", fit.log
    simulated = np.column_stack([log.times, np.degrees(log.requests), np.degrees(log.angles)])
    names = ["t_s", f"{prefix}requested_deg", f"{prefix}actual_deg"]
    return Answer(
        excitation_results(excitation, expected),
        excitation_text(excitation, expected, model=run.model.file),
        lambda file: write_joint_path(
            file, [joint], excitation.requests[:, None], period=excitation.period
        ),
        files=[(expected_log, table_text(names, simulated))],
    )
