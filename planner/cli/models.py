"""From settings to the robot: its legs, and one model per joint."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING

from planner.cli import settings
from planner.cli.console import BadSetting, marked
from planner.exceptions import InvalidFile, InvalidModel
from planner.files.columns import SHARES
from planner.files.joint_model import LegPlace, read_legs, read_model_file
from planner.files.text import STANDARD_STREAM
from planner.model.evidence import refusal
from planner.model.joint import JointModel, joint_of_top_speed

if TYPE_CHECKING:
    from kinematics import Leg


def find_leg(leg: settings.Leg, folder: str = "") -> LegPlace | None:
    """The description of the leg; None if the settings name no leg."""
    near = leg.near and {joint: math.radians(angle) for joint, angle in leg.near.items()}
    is_described = leg.base or leg.foot or leg.lock or leg.lock_m
    if leg.name is not None:
        if leg.urdf or is_described:
            raise BadSetting(
                "‹leg.name› is a shipped leg: leave out ‹leg.urdf›, ‹leg.base›, ‹leg.foot› and "
                "‹leg.lock›"
            )
        return _shipped(leg.name)._replace(near=near)
    if leg.urdf is None:
        if is_described or near:
            raise BadSetting(
                "‹leg.base›, ‹leg.foot›, ‹leg.lock› and ‹leg.near› are of a leg: name it with "
                "‹leg.name› or ‹leg.urdf›"
            )
        return None
    if leg.base is None or leg.foot is None:
        raise BadSetting(
            "‹leg.urdf› needs ‹leg.base› and ‹leg.foot›, the frames at the leg's two ends"
        )
    locked = {joint: math.radians(angle) for joint, angle in (leg.lock or {}).items()}
    locked |= leg.lock_m or {}
    return LegPlace(beside(folder, leg.urdf), leg.base, leg.foot, locked, near)


def _shipped(name: str) -> LegPlace:
    """The simplified leg of the reference walk, or one of the four legs of the ERS-210A."""
    from kinematics import urdf_path

    if name == "reference":
        return LegPlace(str(urdf_path("reference_leg.urdf")), "hip", "foot")
    return LegPlace(str(urdf_path("ers210a.urdf")), "body", f"{name.replace('-', '_')}_ball")


def load_leg(place: LegPlace | None) -> Leg | None:
    """The leg of a description."""
    if place is None:
        return None
    from kinematics import Leg

    return Leg.from_urdf(
        place.urdf, base=place.base, foot=place.foot, locked=place.locked, near=place.near
    )


def legs_of(
    model: settings.Model, folder: str = "", *, among: Sequence[str] | None = None
) -> dict[str, Leg]:
    """The legs of the robot in the model file; the ERS-210A's legs for its own model.

    Of joints that they are ``among``, those whose joints are all there.
    """
    file = robot_file(model, folder)
    places = {} if file is None else read_legs(file)
    if model.file == settings.SHIPPED_MODEL:
        _, *names = settings.LEG_NAMES
        own = tuple(f"{name.replace('-', '_')}_" for name in names)
        if among is None or any(joint.startswith(own) for joint in among):
            places = {name: _shipped(name) for name in names}
    legs = {name: leg for name, place in places.items() if (leg := load_leg(place))}
    if among is None:
        return legs
    return {name: leg for name, leg in legs.items() if {*leg.joint_names} <= {*among}}


def leg_title(leg: settings.Leg) -> str:
    """The name of the leg on pages; empty if the settings name no leg."""
    return leg.name or (f"{Path(leg.urdf).name} · {leg.foot}" if leg.urdf else "")


def models_of(
    run: settings.Run,
    joints: Sequence[str],
    leg: Leg | None = None,
    folder: str = "",
    *,
    units: Sequence[str] = (),
) -> tuple[JointModel, ...]:
    """One model per joint, all with the same time between requests, by default the models' own.

    Of joints whose ``units`` are shares of their range, a percent becomes a degree.
    """
    file, rate = run.model.file, run.path.rate_hz
    models = _by_file(file, joints, leg, folder)
    if rate is not None:
        try:
            models = tuple(each.requested_every(1.0 / rate) for each in models)
        except InvalidModel as error:
            reason = str(error).removeprefix("period: ")
            raise BadSetting(f"‹path.rate_hz›: {reason}") from error
    for name, each in zip(joints, models, strict=True):
        if abs(each.period - models[0].period) > 1e-9 * models[0].period:
            raise InvalidFile(
                beside(folder, file),
                f"'{name}' takes a request every {each.period:g} s and '{joints[0]}' every "
                f"{models[0].period:g} s, expected one rate; plan them one by one",
            )
    if not set(units) & set(SHARES):
        return models
    if file == settings.SHIPPED_MODEL:
        raise BadSetting(
            "the path has joints in shares of their range, of which the ERS-210A's model says "
            "nothing; name models of theirs, as identify writes them, with ‹model.file›"
        )
    pairs = zip(models, units, strict=True)
    return tuple(_in_percent(each) if unit in SHARES else each for each, unit in pairs)


def _by_file(
    name: str, joints: Sequence[str], leg: Leg | None, folder: str
) -> tuple[JointModel, ...]:
    if name == settings.SHIPPED_MODEL:
        return (JointModel.ers210a(),) * len(joints)
    if name != settings.FROM_URDF:
        file = beside(folder, name)
        if not Path(file).suffix and not Path(file).exists():
            raise BadSetting(
                f"‹model.file›: got '{name}', expected '{settings.SHIPPED_MODEL}', "
                f"'{settings.FROM_URDF}', or a file that exists, such as joint.toml",
            )
        return read_model_file(file).for_joints(joints)
    key = marked("model.file", settings.FROM_URDF)
    if leg is None or leg.speeds is None:
        raise BadSetting(f"{key} takes speeds from a leg's URDF: name it with ‹leg.name›")
    speeds = dict(zip(leg.joint_names, leg.speeds.tolist(), strict=True))
    for joint in joints:
        if math.isnan(speeds.get(joint, math.nan)):
            raise BadSetting(
                f"{key}: the URDF has no usable top speed of joint '{joint}'; give a model file, "
                "as `identify` writes it",
            )
    return tuple(joint_of_top_speed(speeds[joint]) for joint in joints)


def _in_percent(model: JointModel) -> JointModel:
    """The model of a joint in shares of its range, scaled so that a percent is a degree."""
    factor = SHARES["range"]
    angles = [each.name for each in fields(model) if each.metadata["unit"].startswith("rad")]
    scaled = replace(model, **{name: factor * getattr(model, name) for name in angles})
    return scaled.with_evidence(model.evidence and model.evidence.scaled(factor))


def refused_models(names: Sequence[str], models: Sequence[JointModel]) -> tuple[str, ...]:
    """A remark on joints whose models are not to be planned with."""
    evidence = [model.evidence for model in models]
    words = refusal(dict(zip(names, evidence, strict=True)))
    return (words,) if words else ()


def model_words(model: settings.Model) -> str:
    """The joint model of an answer, in words."""
    words = {
        settings.SHIPPED_MODEL: f"{settings.SHIPPED_MODEL}, a joint of the Sony Aibo",
        settings.FROM_URDF: "a joint of the Sony Aibo, with the top speeds of the URDF",
    }
    return f"model: {words.get(model.file, model.file)}"


def robot_file(model: settings.Model, folder: str) -> str | None:
    """The model file, if it can be read again for legs and servos; else None."""
    if model.file in (settings.SHIPPED_MODEL, settings.FROM_URDF, STANDARD_STREAM):
        return None
    return beside(folder, model.file)


def beside(folder: str, name: str) -> str:
    """The path of a file that the settings name relative to their own folder."""
    return str(Path(folder) / name) if folder else name
