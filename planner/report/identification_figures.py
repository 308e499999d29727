"""All pictures of an identification, with what they show in words."""

from __future__ import annotations

import math
from typing import NamedTuple

from planner.identification.result import Identification, LogFit
from planner.report import identification_draw as draw
from planner.report import identification_draw_log as draw_log
from planner.report.figures import Picture
from planner.report.identification_cloud import cloud_plot
from planner.report.identification_live import log_plot
from planner.report.identification_parameters import units_of
from planner.report.style import applied


class IdentificationPictures(NamedTuple):
    """The pictures of one joint.

    Attributes:
        cloud: Speed against error, with f.
        intervals: The parameters' intervals.
        alternatives: Errors beside those of simpler models.
        logs: For each log the close-up and the whole.
    """

    cloud: Picture
    intervals: Picture
    alternatives: Picture
    logs: tuple[tuple[Picture, ...], ...]


def identification_pictures(
    identification: Identification, *, prefix: str = ""
) -> IdentificationPictures:
    """Draw every picture of one joint.

    Args:
        identification: What was found.
        prefix: What tells the names of its pictures from those of other joints.
    """
    with applied():
        return IdentificationPictures(
            cloud=_cloud(identification, prefix),
            intervals=Picture(
                f"{prefix}intervals",
                "The parameters and their 95 % intervals",
                "Every strip runs from zero to twice the estimate, that of the static sag as far "
                "to either side; the dark line is the estimate, the bar its interval. An arrow "
                "says that it goes on beyond the strip; orange, that it has no end.",
                "Strips for the parameters, each with a dark line at the estimate and a bar along "
                "its 95 percent interval; the table beside it has the numbers.",
                draw.draw_intervals(identification),
            ),
            alternatives=Picture(
                f"{prefix}alternatives",
                "Error of each description",
                "Rms error of four descriptions of the same rows: that the joint is where it is "
                "told to be, that it is there later, that it follows a first-order lag, and the "
                "joint model. The number is the error on rows held out, where there are any.",
                "Horizontal bars, one per description, whose length is its error; the table has "
                "the numbers.",
                draw.draw_alternatives(identification),
            ),
            logs=tuple(
                _log(identification, fit, f"{prefix}log{k}_")
                for k, fit in enumerate(identification.fits, 1)
            ),
        )


def _cloud(identification: Identification, prefix: str) -> Picture:
    model = identification.model
    age, oldest = 1e3 * model.lag, 1e3 * (model.lag + model.acceleration_time)
    unbounded = "" if identification.saturates else " Its level ends are a guess: no data is there."
    return Picture(
        f"{prefix}speed",
        "Figure 5 from data: the function f",
        "One dot per interval between two rows: upwards the change of the measured angle over the "
        f"interval by its duration, to the right the mean of the requests {age:.0f} to "
        f"{oldest:.0f} ms old, plus the static sag, minus the angle. Dots of a window that lies "
        "on both sides of a corner of f are pale: they may lie off the line. The line is f with "
        f"the identified v_max and θ₀; it was not fitted to these dots.{unbounded}",
        "A cloud of measured speeds over request errors, along a line through the origin that "
        "turns level at the top speed.",
        draw.draw_speed_cloud(identification),
        cloud_plot(identification),
    )


def _log(identification: Identification, fit: LogFit, prefix: str) -> tuple[Picture, ...]:
    units = units_of(identification)
    noise = identification.noise
    shaded = " The shaded part was held out." if fit.held_out.any() else ""
    unseen = (
        "; where the model is green, it was fitted without these rows" if fit.held_out.any() else ""
    )
    level = f"{units.factor * noise:.2g} {units.angle}" if math.isfinite(noise) else "unknown"
    below = (
        f"Below, measured minus predicted, and twice the noise ({level}) either way; outliers are "
        "rows that the robust fit counted by less than half."
    )
    return (
        Picture(
            f"{prefix}close_up",
            "Close up",
            f"The {draw_log.CLOSE_UP:g} seconds in which the joint is farthest from its requests"
            f"{unseen}. {below}",
            "Requests, measured angles and the model's prediction over a few seconds; the "
            "prediction runs through the measured angles. Below, the residuals.",
            draw_log.draw_close_up(fit, units, noise),
        ),
        Picture(
            f"{prefix}whole",
            "The whole log",
            "Requests, measured angles and prediction over all of it; on paper, long logs by the "
            "least and the largest value of each part. Below, measured minus predicted and "
            f"twice the noise ({level}) either way. There is "
            "no prediction where the torque was off or the requests before are not known."
            f"{shaded}",
            "Requests, measured angles and prediction over the whole log. Below, the residuals.",
            draw_log.draw_whole(fit, units, noise),
            log_plot(fit, units, noise),
        ),
    )
