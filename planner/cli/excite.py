"""``request-planner excite``: test signals from which a joint can be identified."""

from __future__ import annotations

import math
from typing import Literal

import click

from planner.cli import options
from planner.cli.console import Answer
from planner.cli.declared import Positive, Span, option
from planner.cli.settings import Run, Seed

Kind = Literal[
    "combined", "steps", "multisine", "chirp", "random-steps", "triangle", "slow-triangle"
]

UNNAMED = "requested"  # the joint of a signal without a name, whose column is requested_deg


@options.command()
def excite(
    *,
    kind: Kind = option(
        "A slow triangle, sines and steps in one recording, or one signal of its own; steps are "
        "the tests of Equation 1.",
        default="combined",
    ),
    limits_deg: Span = option("Range of the requests.", example=[-27, 147]),
    centre_deg: float | None = option(
        "Where the signal begins and ends.", otherwise="the middle of the limits"
    ),
    rate_hz: Positive | None = option(
        "Requests per second.", otherwise="those of the expected model"
    ),
    duration_s: float | None = option(
        "Length of the signal, rests included.", otherwise="60 for combined, else 20"
    ),
    amplitude_deg: tuple[float, ...] = option(
        "Height of a step test. Repeat the option for several.",
        otherwise="an eighth, half and the whole of the range",
    ),
    cycles: int | None = option(
        "Cycles of each step test.", otherwise="3; 1 in each half of combined"
    ),
    highest_hz: float | None = option(
        "Highest frequency of sines and chirp.", otherwise="a tenth of the rate, at most 5"
    ),
    seed: Seed = option("Another number draws other random steps and noise.", default=0),
    joint: str = option("Name of the joint, for the column.", default=UNNAMED, form="NAME"),
    run: Run = options.settings("model: file"),
    noise_deg: float = option(
        "Expected noise of the measured angles, standard deviation.", default=0.2
    ),
    resolution_deg: float = option("Expected resolution of the sensor.", default=0.3),
    expected_log: options.Output | None = option(
        "Also write the log of a simulated joint, as an input for identify."
    ),
    output: str = options.output,  # noqa: ARG001
) -> Answer:
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

    (low, high), turns = limits_deg, 720.0
    if high - low > turns:
        raise click.UsageError(
            f"--limits-deg: got {low:g}:{high:g}, expected at most {turns:g} degrees from one to "
            "the other, two turns; are they counts of a sensor?"
        )
    for name, value, kinds in (
        ("--amplitude-deg", amplitude_deg, ("combined", "steps")),
        ("--cycles", cycles, ("combined", "steps")),
        ("--highest-hz", highest_hz, ("combined", "multisine", "chirp")),
    ):
        if value not in (None, ()) and kind not in kinds:
            raise click.UsageError(f"{name} has no effect with --kind {kind}.")
    finest = 1e-9  # a turn of 38 bits: more than any sensor has
    if 0.0 < resolution_deg < finest:
        raise click.UsageError(
            f"--resolution-deg: got {resolution_deg:g}, expected 0 for none, or at least "
            f"{finest:g}."
        )
    (model,) = models_of(run, [joint])
    usual = 60.0 if kind == "combined" else 20.0
    excitation = make(
        kind.replace("-", "_"),
        limits=(math.radians(low), math.radians(high)),
        period=model.period if rate_hz is None else 1.0 / rate_hz,
        duration=usual if duration_s is None else duration_s,
        centre=None if centre_deg is None else math.radians(centre_deg),
        amplitudes=[math.radians(height) for height in amplitude_deg] or None,
        cycles=cycles,
        highest=highest_hz,
        seed=seed,
    )
    expected = expect(
        excitation,
        model,
        noise=math.radians(noise_deg),
        resolution=math.radians(resolution_deg),
        seed=seed,
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
