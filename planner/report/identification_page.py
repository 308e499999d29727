"""The report of an identification as one HTML page that needs nothing else."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from itertools import chain
from typing import NamedTuple

import numpy as np

from planner._version import __version__
from planner.identification.result import Identification, speed_against_error
from planner.report.identification_figures import IdentificationPictures, identification_pictures
from planner.report.identification_parameters import Parameter, Units, parameters, units_of
from planner.report.identification_words import Error, errors, known, telling_error, verdict
from planner.report.linked_files import LinkedFile
from planner.report.live_page import live_head, live_scripts
from planner.report.page import PARAMETERS, drawn, environment
from planner.report.results import versions
from planner.report.style import ROLES

LIBRARIES = ("request-planner", "python", "numpy", "scipy", "matplotlib", "plotly")
"""Whose versions stand at the end of the page."""


class Joint(NamedTuple):
    """What the page says about one joint.

    Attributes:
        name: Its name; empty where the logs have none.
        anchor: Its identifier on the page.
        found: What was identified.
        verdict: The verdict in a sentence.
        known: What is determined, in a sentence.
        error: The error that tells most [rad].
        where: On which rows it was measured.
        units: Units in which it is told.
        parameters: Rows of the table of parameters.
        errors: Rows of the table of errors.
        saturated: Share of the measured intervals that were wholly at the top speed.
        pictures: Its pictures.
    """

    name: str
    anchor: str
    found: Identification
    verdict: str
    known: str
    error: float
    where: str
    units: Units
    parameters: list[Parameter]
    errors: list[Error]
    saturated: float
    pictures: IdentificationPictures


def identification_page(
    identifications: Mapping[str, Identification], *, files: Sequence[LinkedFile] = ()
) -> str:
    """The whole page: what holds and what does not first, where it comes from last.

    Args:
        identifications: By joint; "" for one without a name.
        files: Files of the run to link to.
    """
    joints = [
        _joint(name, found, f"joint{k}_" if len(identifications) > 1 else "")
        for k, (name, found) in enumerate(identifications.items(), 1)
    ]
    shown = [
        picture
        for joint in joints
        for picture in (joint.pictures.cloud, *chain(*joint.pictures.logs))
    ]
    live = {picture.name: picture.live for picture in shown if picture.live is not None}
    found = versions()
    return (
        environment()
        .get_template("identification.html")
        .render(
            joints=joints,
            drawn=drawn,
            live_head=live_head(),
            live_scripts=live_scripts(live),
            roles=ROLES,
            files=files,
            origins=(),
            words=PARAMETERS,
            made_by=f"request-planner {__version__} identify",
            versions={name: found[name] for name in LIBRARIES},
        )
    )


def _joint(name: str, found: Identification, prefix: str) -> Joint:
    error, where = telling_error(found)
    said = verdict(found).replace(" %", "\N{NO-BREAK SPACE}%")
    return Joint(
        name=name,
        anchor=re.sub(r"\W+", "-", f"{prefix}{name or 'joint'}"),
        found=found,
        verdict=said[0].upper() + said[1:],
        known=known(found),
        error=error,
        where=where,
        units=units_of(found),
        parameters=parameters(found),
        errors=errors(found),
        saturated=_saturated(found),
        pictures=identification_pictures(found, prefix=prefix),
    )


def _saturated(found: Identification) -> float:
    clouds = [speed_against_error(found.model, fit) for fit in found.fits]
    intervals = sum(len(cloud.errors) for cloud in clouds)
    return sum(int(np.sum(cloud.saturated)) for cloud in clouds) / max(1, intervals)
