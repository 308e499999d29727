"""Model files as TOML: the fields of JointModel in SI, for every joint or in a table per joint.

A file may hold the robot, too: its legs, its bus and its servos.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, get_args

import numpy as np

from planner.exceptions import InvalidFile, InvalidInput, InvalidModel, nearest
from planner.files.text import STANDARD_STREAM, Toml, key_name, read_toml, toml_value
from planner.model.evidence import ACCEPTED, GAIN, Evidence, Verdict, warn_of_refused
from planner.model.joint import JointModel
from planner.trajectory import LARGEST, Array
from planner.validation import as_number, as_reals, as_whole, is_one_of, shown

if TYPE_CHECKING:
    from planner.robot.arm import Servo

PARAMETER_UNITS = {each.name: each.metadata.get("unit", "-") for each in fields(JointModel)}
"""The unit of every parameter."""

FIELDS = tuple(PARAMETER_UNITS)
TESTED: dict[str, tuple[tuple[int, ...], str]] = {
    "expected_error": ((), "[rad] rms error on rows that were not fitted"),
    "tested_speed": ((), "[rad/s] fastest motion of the logs"),
    "tested_load": ((), "[N m] largest torque of the logs"),
    "tested_angles": ((2,), "[rad] least and largest angle of the logs"),
    "error_by_acceleration": (
        (0, 2),
        "[rad/s^2, rad] accelerations, each with the error of such motion, all rms",
    ),
    "delay_error": ((), "[s] uncertainty of the delay of moving requests, if none were logged"),
    "error_spread": ((2,), "[-] least and largest error of 90 % of motions over the expected one"),
    "error_over_delay": ((), "[-] error on rows that were not fitted over a pure delay's"),
}
"""Keys beside the parameters, for the first fields of Evidence: shapes and meanings."""

INTERVALS = {
    f"{name}_interval": (name, unit)
    for name, unit in {
        **{each.name: each.metadata["unit"] for each in fields(JointModel)},
        GAIN: "1/s",
    }.items()
    if name not in ("tick", "hold")
}
"""Keys of intervals: the parameter of each, and its unit."""

CORRELATIONS = "correlations"
"""Key of the correlations of the parameters that have intervals, in the order of these."""

VERDICT, REASON = "verdict", "verdict_reason"
"""Keys of the verdict on a model, and of its reason."""

JOINT = "joint"
"""Key above all tables: the joint of which the model there was identified, if it has a name."""

KNOWN = (*FIELDS, *TESTED, *INTERVALS, CORRELATIONS, VERDICT, REASON)
"""Every key of a model."""

KINDS = ("a number from 0 to 1e9", "two numbers up to 1e9", "pairs of numbers from 0 to 1e9")
"""Expected values in words, by number of axes: 1e9 is ``LARGEST``."""

REQUIRED = tuple(each.name for each in fields(JointModel) if each.default is MISSING)

LEG, SERVO = "leg", "servo"
"""Keys of the tables ``[leg.<name>]`` and ``[<joint>.servo]``."""

BUS = {"bus": str, "port": str, "baud_rate": int}
"""Keys above all tables for the place and the type of the servos."""

Kinds = Mapping[str, tuple[Callable[[Any], bool], str]]
"""By key, whether a value is one, and what is expected."""


def _is_text(value: Any) -> bool:
    return isinstance(value, str) and value != ""


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and math.isfinite(as_number(value))


def _is_pose(value: Any) -> bool:
    return isinstance(value, dict) and all(map(_is_number, value.values()))


def _is_whole(value: Any) -> bool:
    return as_whole(value) is not None


def _is_range(value: Any) -> bool:
    return isinstance(value, list) and [*map(_is_number, value)] == [True, True]


LEG_KEYS: Kinds = {
    "urdf": (_is_text, "the description of the robot, a file beside this one"),
    "base": (_is_text, "the frame at the leg's upper end"),
    "foot": (_is_text, "the frame at its lower end"),
    "near_deg": (_is_pose, "a table of angles of the standing pose [deg]"),
    "lock_deg": (_is_pose, "a table of joints that are held, with their angles [deg]"),
}


class LegPlace(NamedTuple):
    """A leg in the file that describes it: the frames at its ends, and locked joints [rad or m].

    Paths start near the pose ``near`` [rad]; None is any.
    """

    urdf: str
    base: str
    foot: str
    locked: Mapping[str, float] = {}
    near: Mapping[str, float] | None = None


@dataclass(frozen=True)
class ModelFile:
    """Models of joints: one for every joint without a table of its own, and those in tables."""

    path: str
    common: JointModel | None
    by_joint: Mapping[str, JointModel]
    joint: str = ""  # the joint from whose logs the model for every joint is; "" where unknown

    def one(self) -> JointModel:
        """The only model of the file."""
        models = [*self.by_joint.values()] if self.common is None else [self.common]
        if len(models) != 1:
            raise InvalidFile(
                self.path,
                f"holds models of {', '.join(self.by_joint)}, expected one; name the joint",
            )
        return models[0]

    def for_joints(self, names: Sequence[str]) -> tuple[JointModel, ...]:
        """The model of each named joint."""
        models = []
        for name in names:
            model = self.by_joint.get(name, self.common)
            hint = nearest(name, [table for table in self.by_joint if table not in names])
            if model is None or (hint and name not in self.by_joint):
                tables = ", ".join(f"[{table}]" for table in self.by_joint) or "none"
                raise InvalidFile(
                    self.path,
                    f"no table for the joint '{name}'{hint}; tables: {tables}; add [{name}], or "
                    "write the parameters above all tables to have them for every joint",
                )
            models.append(model)
        return tuple(models)


def read_models(path: Path | str) -> dict[str, JointModel]:
    """Read joint models from TOML, or from standard input for ``-``.

    Keys above all tables hold for every joint; a table ``[knee]`` sets or changes some for one.
    Keys and tables of the robot (legs, bus, servos) are ignored here.

    Args:
        path: The file, as ``identify`` and :meth:`planner.JointModel.to_toml` write it.

    Returns:
        The models by joint, with their tests and the intervals of their parameters, where the file
        has them: :attr:`planner.JointModel.evidence`. The key ``""`` holds the model of all joints
        without a table of their own, if there is one; :func:`planner.plan` takes the dict as it
        is.

    Warns:
        UserWarning: The ``verdict`` of a model advises against planning with it.

    Raises:
        InvalidFile: Not TOML, an unknown or missing key, or parameters that describe no joint.
        InvalidInput: The path is not the name of a file.

    Example:
        >>> from pathlib import Path
        >>> from tempfile import TemporaryDirectory
        >>> with TemporaryDirectory() as folder:
        ...     JointModel.ers210a().to_toml(Path(folder, "any.toml"))
        ...     models = read_models(Path(folder, "any.toml"))
        >>> models == {"": JointModel.ers210a()}
        True
    """
    if not isinstance(path, Path | str):
        raise InvalidInput(f"path: got {shown(path)}, expected the name of a model file")
    file = read_model_file(path)
    models = ({} if file.common is None else {"": file.common}) | dict(file.by_joint)
    warn_of_refused({joint: model.evidence for joint, model in models.items()})
    return models


def read_model_file(path: Path | str) -> ModelFile:
    """Read joint models, and where they came from; see :func:`read_models`."""
    file = read_toml(path, example="v_max = 5.45")
    path = file.path
    content = {key: each for key, each in file.content.items() if not is_of_robot(key, each)}
    common = {key: value for key, value in content.items() if not isinstance(value, dict)}
    of_joint = common.pop(JOINT, "")
    if not isinstance(of_joint, str):
        raise file.fault(f"{JOINT}: got {shown(of_joint)}, expected the name of a joint", (JOINT,))
    tables = {
        joint: {key: each for key, each in own.items() if (key, type(each)) != (SERVO, dict)}
        for joint, own in content.items()
        if isinstance(own, dict)
    }
    for table, keys in (("", common), *tables.items()):
        if unknown := [key for key in keys if key not in KNOWN]:
            key, place = unknown[0], f" in [{table}]" if table else ""
            raise file.fault(
                f"unknown key '{key}'{place}{nearest(key, KNOWN)}; keys: {', '.join(FIELDS)}",
                (table, key) if table else (key,),
            )
    complete = not tables or all(key in common for key in REQUIRED)
    model = _model(path, common, common, "") if complete else None
    by_joint = {
        # A table that changes parameters is another model: its evidence is in the table.
        table: _model(path, {**common, **own}, own, f"table [{table}]: ")
        for table, own in tables.items()
    }
    return ModelFile(path, model, by_joint, of_joint)


def models_text(
    models: Mapping[str, JointModel],
    *,
    beside: Path | str = STANDARD_STREAM,
    remarks: Sequence[str] = (),
    about: Mapping[str, Mapping[str, str]] | None = None,
    servos: Mapping[str, Servo] | None = None,
    bus: Mapping[str, str | int] | None = None,
    of_joint: str = "",
) -> str:
    """Models by joint as TOML that :func:`read_models` reads; "" stands above all tables.

    The model above all tables is that ``of_joint``, if this has a name. ``remarks`` are comments at
    the top; ``about`` are, by joint, comments by key that take the place of the key's unit, and
    under "" one above the joint's keys.

    Of a file ``beside``, if there is one, other joints, servos and legs are kept, and its bus where
    none is named. A joint whose table changes nothing of the model above all tables keeps to that
    model, also to a new one. A model above all tables of a known joint gets a table of its own
    beside a model of another joint.
    """
    models, servos, legs = dict(models), dict(servos or {}), ""
    if has_content(beside):
        file = read_model_file(beside)
        above = file.joint if file.joint not in ("", of_joint) else ""
        kept = {} if file.common is None else {above: file.common}
        for joint, model in file.by_joint.items():
            kept[joint] = models.get("", model) if model == file.common else model
        models, servos = kept | models, read_servos(beside, optional=True) | servos
        bus, legs = read_bus(beside) if bus is None else bus, legs_text(beside)
    # A table inherits the keys above all tables, unless it sets them.
    inherited = models[""].parameters() if "" in models else {}
    blocks = ["\n".join(_comment(remark) for remark in remarks)] if remarks else []
    if bus:
        blocks.append("\n".join(f"{key} = {toml_value(value)}" for key, value in bus.items()))
    for joint, model in models.items():
        comments = (about or {}).get(joint, {})
        lines = [f"[{key_name((joint,))}]"] if joint else []
        lines += [_comment(line) for line in comments.get("", "").splitlines()]
        if of_joint and not joint:
            words = "this model holds for joints of any name"
            lines.append(f"{JOINT} = {toml_value(of_joint)}  # was identified; {words}")
        lines += [
            f"{name} = {getattr(model, name)!r}  "
            + _comment(comments.get(name, f"[{PARAMETER_UNITS[name]}]"))
            for name in model.parameters() | inherited
        ]
        if model.evidence is not None:
            lines += _evidence_lines(model.evidence)
        if joint in servos:
            servo = servos[joint]
            lines += [
                "",
                f"[{key_name((joint,))}.{SERVO}]",
                f"id = {servo.id}",
                f"zero_tick = {servo.zero_tick}  # count at angle 0",
                f"direction = {servo.direction}  "
                "# -1 where the servo is mounted the other way round",
                f"ticks_per_turn = {servo.ticks_per_turn}",
                f"limits = {list(servo.limits)}  # [rad] least and largest request",
                *(f"{name} = {value}" for name, value in servo.settings.items()),
            ]
        blocks.append("\n".join(lines))
    return "\n\n".join(blocks) + "\n" + legs


def has_content(path: Path | str) -> bool:
    """Whether there is a file that is not empty; not on standard output, ``-``."""
    name = str(path)
    return name != STANDARD_STREAM and Path(path).is_file() and Path(path).stat().st_size > 0


def _comment(text: str) -> str:
    """A comment on one line, without characters that TOML forbids."""
    return "# " + "".join(mark if mark.isprintable() else " " for mark in text)


def _evidence_lines(evidence: Evidence) -> list[str]:
    """The evidence of a model: its test, verdict, intervals and their correlations."""
    tested: tuple[Any, ...] = evidence
    lines = [
        f"{key} = {json.dumps(value)}  # {TESTED[key][1]}"
        for key, value in zip(TESTED, tested, strict=False)
        if np.size(value) and np.isfinite(value).all()
    ]
    if evidence.verdict is not None:
        accepted = " or ".join(f'"{each}"' for each in ACCEPTED)
        verdict = toml_value(evidence.verdict)
        lines.append(f"{VERDICT} = {verdict}  # to plan with only if {accepted}")
        if evidence.reason:
            lines.append(f"{REASON} = {toml_value(evidence.reason)}")
    lines += [
        f"{name}_interval = [{least!r}, {most!r}]  # 95 %{' [1/s]' * (name == GAIN)}"
        for name, (least, most) in evidence.intervals.items()
    ]
    if evidence.correlations:
        matrix = json.dumps(evidence.correlations)
        lines.append(f"{CORRELATIONS} = {matrix}  # of the intervals above")
    return lines


def _model(
    path: Path | str, keys: Mapping[str, Any], own: Mapping[str, Any], place: str
) -> JointModel:
    """The model of these keys, with the evidence in its own keys."""
    missing = [key for key in REQUIRED if key not in keys]
    if missing:
        raise InvalidFile(
            path,
            f"{place}no {', '.join(missing)}; expected {', '.join(REQUIRED)} in rad/s, rad, s, s",
        )
    times = [keys[key] for key in ("lag", "acceleration_time")]
    slowest = 10.0  # no servo takes so long to answer a request [s]: the unit is another
    if all(isinstance(time, int | float) for time in times) and sum(times) > slowest:
        raise InvalidFile(
            path,
            f"{place}lag + acceleration_time: got {sum(times):g} s, "
            f"expected at most {slowest:g} s; 32 ms are 0.032 (v_max is in rad/s, theta_0 in rad)",
        )
    try:
        model = JointModel(**{key: value for key, value in keys.items() if key in FIELDS})
    except InvalidModel as error:
        raise InvalidFile(path, f"{place}{error}") from error
    doubtful = [
        f"{name} = {value:g} {unit}: is it in degrees? expected at most {most:.4g} {unit}; "
        f"{value:g} {unit.replace('rad', 'deg')} are {name} = {math.radians(value):.4g}"
        for name, value, unit, most in (
            ("v_max", model.v_max, "rad/s", 60.0),  # direct drives reach 40
            ("theta_0", model.theta_0, "rad", math.pi),
        )
        if value > most
    ]
    if doubtful and not any(key in INTERVALS for key in own):  # identify writes them, and radians
        raise InvalidFile(path, place + "; ".join(doubtful))
    try:
        evidence = _evidence(own, model)
        return model.with_evidence(Evidence(**evidence)) if evidence else model
    except InvalidInput as error:
        raise InvalidFile(path, f"{place}{error}") from error


def _evidence(keys: Mapping[str, Any], model: JointModel) -> dict[str, Any]:
    """The test, the intervals and the verdict of a model, as fields of Evidence."""
    evidence: dict[str, Any] = {}
    for (key, (shape, words)), name in zip(TESTED.items(), Evidence._fields, strict=False):
        if "expected_error" not in keys or key not in keys:
            continue
        values = _reals(keys[key])
        fits = values.ndim == len(shape) and values.shape[-1:] == shape[-1:]
        least = -LARGEST if key == "tested_angles" else 0.0
        if not fits or not np.all((least <= values) & (values <= LARGEST)):
            expected = f"{KINDS[len(shape)]}: {words}"
            raise InvalidInput(f"{key}: got {shown(keys[key])}, expected {expected}")
        evidence[name] = _as_tuples(values.tolist())
    declared = [key for key in keys if key in INTERVALS]
    both = [f"{name}_interval" for name in (GAIN, "theta_0")]
    if set(both) <= set(declared):
        raise InvalidInput(
            f"got {' and '.join(both)}, expected one of them: by v_max one follows from the other"
        )
    intervals = {}
    for key in declared:
        name, unit = INTERVALS[key]
        value = model.v_max / model.theta_0 if name == GAIN else getattr(model, name)
        ends, rounding = _reals(keys[key]), 1e-9 * abs(value)
        if ends.shape != (2,) or not ends[0] - rounding <= value <= ends[1] + rounding:
            raise InvalidInput(
                f"{key}: got {shown(keys[key])}, expected least and largest value [{unit}], with "
                f"{value:g}, that of the model, between them; inf or -inf where there is none"
            )
        intervals[name] = (float(ends[0]), float(ends[1]))
    if intervals:
        evidence["intervals"] = intervals
    if CORRELATIONS in keys:
        evidence["correlations"] = _as_tuples(keys[CORRELATIONS])
    verdicts = ", ".join(f"'{each}'" for each in get_args(Verdict))
    for key, name, fits, words in (
        (VERDICT, "verdict", is_one_of(keys.get(VERDICT), get_args(Verdict)), f"one of {verdicts}"),
        (REASON, "reason", isinstance(keys.get(REASON), str), "the reason in words"),
    ):
        if key in keys:
            evidence[name] = keys[key]
            if not fits:
                raise InvalidInput(f"{key}: got {shown(keys[key])}, expected {words}")
    return evidence


def _reals(value: Any) -> Array:
    """Numbers of a file; NaN for anything else."""
    try:
        return as_reals(value)
    except (TypeError, ValueError):
        return np.array(math.nan)


def _as_tuples(value: Any) -> Any:
    return tuple(map(_as_tuples, value)) if isinstance(value, list) else value


def is_of_robot(key: str, value: Any) -> bool:
    """Whether a key of a model file is about the robot, and no parameter and no joint."""
    if key == LEG:
        return isinstance(value, dict) and all(isinstance(each, dict) for each in value.values())
    return type(value) is BUS.get(key)


def read_legs(path: Path | str) -> dict[str, LegPlace]:
    """The legs of a model file, by name: its tables ``[leg.<name>]``; none where it has none."""
    file = read_toml(path, example='urdf = "robot.urdf"')
    legs = {}
    for name, table in _leg_tables(file).items():
        _check(file, (LEG, name), table, LEG_KEYS, ("urdf", "base", "foot"))
        locked, near = (
            {joint: math.radians(angle) for joint, angle in table.get(key, {}).items()}
            for key in ("lock_deg", "near_deg")
        )
        urdf = str(Path(file.path).parent / table["urdf"])
        pose = near if "near_deg" in table else None
        legs[name] = LegPlace(urdf, table["base"], table["foot"], locked, pose)
    return legs


def legs_text(path: Path | str) -> str:
    """The tables of the legs of a model file as TOML, as they are, but for comments."""
    tables = _leg_tables(read_toml(path, example='urdf = "robot.urdf"'))
    return "".join(
        f"\n[{LEG}.{key_name((name,))}]\n"
        + "".join(f"{key} = {toml_value(value)}\n" for key, value in table.items())
        for name, table in tables.items()
    )


def _leg_tables(file: Toml) -> dict[str, dict[str, Any]]:
    tables: dict[str, Any] = file.content.get(LEG, {})
    return tables if is_of_robot(LEG, tables) else {}


def read_bus(path: Path | str) -> dict[str, Any]:
    """Bus, port and baud rate of a model file, where it has them."""
    file = read_toml(path, example='bus = "feetech"')
    settings = {
        key: value
        for key, value in file.content.items()
        if key in BUS and not isinstance(value, dict)
    }
    for key, value in settings.items():
        if not is_of_robot(key, value):
            expected = "a text in quotes" if BUS[key] is str else "a whole number"
            raise file.fault(f"{key}: got {shown(value)}, expected {expected}", (key,))
        if "\0" in str(value):
            raise file.fault(f"{key}: got {shown(value)}, expected no null character", (key,))
    return settings


def read_servos(
    path: Path | str, joints: Sequence[str] | None = None, *, optional: bool = False
) -> dict[str, Servo]:
    """The servos of a model file, of these joints or of all: its tables ``[<joint>.servo]``.

    There may be none only if they are ``optional``.
    """
    from planner.robot.arm import SETTINGS, Servo  # imports the drivers of the buses

    keys: Kinds = {
        **dict.fromkeys(("zero_tick", "direction", *SETTINGS), (_is_whole, "a whole number")),
        "id": (_is_whole, "a whole number, the servo's identifier on the bus"),
        "ticks_per_turn": (_is_number, "a number"),
        "limits": (_is_range, "two angles [rad]"),
    }
    file, servos = read_toml(path, example="id = 1"), {}
    for joint, own in file.content.items():
        table = own.get(SERVO) if isinstance(own, dict) else None
        if not isinstance(table, dict):
            continue
        _check(file, (joint, SERVO), table, keys, ("id",))
        arguments = {key: value for key, value in table.items() if key not in SETTINGS}
        if "limits" in arguments:
            arguments["limits"] = tuple(map(float, arguments["limits"]))
        settings = {key: value for key, value in table.items() if key in SETTINGS}
        try:
            servos[joint] = Servo(**arguments, settings=settings)
        except InvalidInput as error:
            raise InvalidFile(file.path, f"[{joint}.{SERVO}]: {error}") from error
    if not servos and not optional:
        raise InvalidFile(
            file.path,
            "no table of a servo; expected tables such as [knee.servo] with id, zero_tick and "
            "direction, as calibrate writes them",
        )
    if missing := [name for name in joints or () if name not in servos]:
        raise InvalidFile(
            file.path,
            f"no servo of {', '.join(missing)}; servos are of {', '.join(servos)}: calibrate it, "
            "or name the columns alike",
        )
    return servos if joints is None else {name: servos[name] for name in joints}


def _check(
    file: Toml, place: Sequence[str], table: Mapping[str, Any], kinds: Kinds, needed: Sequence[str]
) -> None:
    """Refuse unknown keys of a table, values that are not of their kind, and missing keys."""
    name = ".".join(place)
    for key, value in table.items():
        words = ""
        if key not in kinds:
            words = f"unknown key '{key}'{nearest(key, [*kinds])}; keys: {', '.join(kinds)}"
        elif not kinds[key][0](value):
            words = f"{key}: got {shown(value)}, expected {kinds[key][1]}"
        if words:
            raise file.fault(f"[{name}]: {words}", (*place, key))
    if missing := [key for key in needed if key not in table]:
        meanings = "; ".join(f"{key} is {kinds[key][1]}" for key in missing)
        raise file.fault(f"[{name}] has no {', '.join(missing)}; {meanings}", place)
