"""Model files as TOML: the fields of JointModel in SI, for every joint or in a table per joint.

A file may hold the robot, too: its legs, its bus and its servos.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import MISSING, fields
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, get_args

import numpy as np

from planner.arrays import LARGEST, as_number, as_whole, shown
from planner.exceptions import InvalidFile, InvalidInput, InvalidModel, nearest
from planner.files.text import Expected, Kind, Toml, key_name, read_toml, toml_value, within
from planner.model.evidence import (
    ACCEPTED,
    GAIN,
    AngleUnit,
    Evidence,
    Verdict,
    warn_of_refused,
)
from planner.model.joint import JointModel
from planner.robot import EXPECTED_BUS, bus_name

if TYPE_CHECKING:
    from planner.robot.arm import Servo


class Key(NamedTuple):
    """A key of a table: the value as it is used, or None, and what is expected, in words."""

    fitted: Callable[[Any], Any]  # which may raise ValueError instead
    words: str = ""
    comment: str = ""  # beside the key in a file


def _some(value: Any) -> Any:
    if not value:
        raise ValueError
    return value


# what the values of keys are: names, numbers, and angles by joint, in degrees in the file [rad]
_text = Kind(Annotated[str, Expected("a text", _some)]).fitted
_value = Annotated[float, within(ge=-LARGEST, le=LARGEST)]
_pair = tuple[_value, _value]
_pose = Kind(dict[str, Annotated[float, Expected("an angle", math.radians)]]).fitted
_size = Annotated[float, within(ge=0.0, le=LARGEST)]


def _tested(comment: str, kind: Any = _size, words: str = "a number from 0 to 1e9") -> Key:
    return Key(Kind(kind).fitted, f"{words}: {comment}", comment)


def _tuples(value: Any) -> Any:
    return tuple(map(_tuples, value)) if isinstance(value, list) else value


def _number(value: Any) -> float | None:
    return value if isinstance(value, int | float) and math.isfinite(as_number(value)) else None


PARAMETER_UNITS = {each.name: each.metadata.get("unit", "-") for each in fields(JointModel)}
REQUIRED = tuple(each.name for each in fields(JointModel) if each.default is MISSING)

# Keys beside the parameters, for the first fields of Evidence.
TESTED = {
    "expected_error": _tested("[rad] rms error on rows that were not fitted"),
    "tested_speed": _tested("[rad/s] fastest motion of the logs"),
    "tested_load": _tested("[N m] largest torque of the logs"),
    "tested_angles": _tested(
        "[rad] least and largest angle of the logs", _pair, "two numbers up to 1e9"
    ),
    "error_by_acceleration": _tested(
        "[rad/s^2, rad] accelerations, each with the error of such motion, all rms",
        Annotated[tuple[tuple[_size, _size], ...], Expected("pairs", _some)],
        "pairs of numbers from 0 to 1e9",
    ),
    "delay_error": _tested("[s] uncertainty of the delay of moving requests, if none were logged"),
    "error_spread": _tested(
        "[-] least and largest error of 90 % of motions over the expected one",
        tuple[_size, _size],
        "two numbers up to 1e9",
    ),
    "error_over_delay": _tested("[-] error on rows that were not fitted over a pure delay's"),
}

# The field of Evidence for each of its keys but the intervals.
EVIDENCE = dict(zip(TESTED, Evidence._fields, strict=False))
EVIDENCE |= {"verdict": "verdict", "verdict_reason": "reason", "angle_unit": "unit"}
EVIDENCE |= {"correlations": "correlations"}

MODEL = {
    # parameters and intervals are checked when all are known
    **{name: Key(_tuples, comment=f"[{unit}]") for name, unit in PARAMETER_UNITS.items()},
    **{
        f"{name}_interval": Key(lambda value: value, comment="95 %" + " [1/s]" * (name == GAIN))
        for name in (*PARAMETER_UNITS, GAIN)
        if name not in ("tick", "hold")
    },
    **TESTED,
    "correlations": Key(_tuples, comment="of the intervals above"),
    "verdict": Key(
        Kind(Verdict).fitted,
        f"one of {', '.join(map(repr, get_args(Verdict)))}",
        f"to plan with only if {' or '.join(map(toml_value, ACCEPTED))}",
    ),
    "verdict_reason": Key(_text, "the reason in words"),
    "angle_unit": Key(
        Kind(AngleUnit).fitted,
        f"one of {', '.join(map(repr, get_args(AngleUnit)))}",
        'of the logs; "range" for shares of the joint\'s range',
    ),
}

# Keys above all tables: the place and the type of the servos, and all.
BUS = {
    "bus": Key(bus_name, EXPECTED_BUS),
    "port": Key(_text, "a text in quotes"),
    "baud_rate": Key(as_whole, "a whole number"),
}
OF_ANY = "was identified; this model holds for joints of any name"
ABOVE = {"joint": Key(_text, "the name of a joint", OF_ANY), **MODEL, **BUS}

LEG_KEYS = {
    "urdf": Key(_text, "the description of the robot, a file beside this one"),
    "base": Key(_text, "the frame at the leg's upper end"),
    "foot": Key(_text, "the frame at its lower end"),
    "near_deg": Key(_pose, "a table of angles of the standing pose [deg]"),
    "lock_deg": Key(_pose, "a table of joints that are held, with their angles [deg]"),
}

# Keys of a servo, beside those of its settings.
SERVO_KEYS = {
    "id": Key(as_whole, "a whole number, the servo's identifier on the bus"),
    "zero_tick": Key(as_whole, "a whole number", "count at angle 0"),
    "direction": Key(as_whole, "a whole number", "-1 where it is mounted the other way round"),
    "ticks_per_turn": Key(_number, "a number"),
    "limits": Key(Kind(_pair).fitted, "two angles [rad]", "[rad] least and largest request"),
}


class LegPlace(NamedTuple):
    """A leg in the file that describes it."""

    urdf: str
    base: str  # the frames at its ends
    foot: str
    locked: Mapping[str, float] = {}  # joints that are held [rad or m]
    near: Mapping[str, float] | None = None  # pose near which paths start [rad]; None for any


class ModelFile(NamedTuple):
    """Models of joints; the key "" holds the model of every joint without a table of its own."""

    path: str
    models: dict[str, JointModel]
    joint: str = ""  # the joint from whose logs the model for every joint is; "" where unknown

    def one(self) -> JointModel:
        """The only model of the file, or the one for every joint."""
        if "" not in self.models and len(self.models) != 1:
            words = f"holds models of {', '.join(self.models)}, expected one; name the joint"
            raise InvalidFile(self.path, words)
        return next(iter(self.models.values()))

    def for_joints(self, names: Sequence[str]) -> tuple[JointModel, ...]:
        """The model of each named joint."""
        tables = [name for name in self.models if name]
        for name in [name for name in names if name not in tables]:
            hint = nearest(name, [table for table in tables if table not in names])
            if hint or "" not in self.models:
                listed = ", ".join(f"[{table}]" for table in tables) or "none"
                raise InvalidFile(
                    self.path,
                    f"no table for the joint '{name}'{hint}; tables: {listed}; add [{name}], or "
                    "write the parameters above all tables to have them for every joint",
                )
        return tuple(self.models[name if name in tables else ""] for name in names)


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
    models = read_model_file(path).models
    warn_of_refused({joint: model.evidence for joint, model in models.items()})
    return models


def read_model_file(path: Path | str) -> ModelFile:
    """Read joint models, and where they came from; see :func:`read_models`."""
    file = read_toml(path, example="v_max = 5.45")
    legs, tables = _legs(file), dict[str, dict[str, Any]]()
    above = {key: each for key, each in file.content.items() if not isinstance(each, dict)}
    common = _checked(file, (), above, ABOVE)
    for table, keys in file.content.items():
        if isinstance(keys, dict) and keys is not legs:
            own = {n: each for n, each in keys.items() if (n, type(each)) != ("servo", dict)}
            tables[table] = _checked(file, (table,), own, MODEL)
    models = {}
    if not tables or all(key in common for key in REQUIRED):
        models[""] = _model(file, common, common)
    for table, own in tables.items():  # one that changes parameters has evidence of its own
        models[table] = _model(file, common | own, own, table)
    return ModelFile(file.path, models, common.get("joint", ""))


def models_text(
    models: Mapping[str, JointModel],
    *,
    beside: Path | str = "-",
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
    model, also to a new one, which beside a model of another joint gets a table of its own.
    """
    models, servos, legs = dict(models), dict(servos or {}), dict[str, dict[str, Any]]()
    if has_content(beside):
        file = read_model_file(beside)
        above = file.joint if file.joint not in ("", of_joint) else ""
        kept = dict[str, JointModel]()
        for joint, model in file.models.items():
            same = joint and model == file.models.get("")
            kept[joint or above] = models.get("", model) if same else model
        models, servos = kept | models, read_servos(beside, optional=True) | servos
        bus, legs = read_bus(beside) if bus is None else bus, _legs(read_toml(beside, example=""))
    # A table inherits the keys above all tables, unless it sets them.
    inherited = models[""].parameters() if "" in models else {}
    blocks = [[_comment(remark) for remark in remarks], _lines(bus or {})]
    for joint, model in models.items():
        comments = (about or {}).get(joint, {})
        lines = [f"[{key_name((joint,))}]"] if joint else []
        lines += [_comment(line) for line in comments.get("", "").splitlines()]
        values = {"joint": of_joint} if of_joint and not joint else dict[str, Any]()
        values |= {name: getattr(model, name) for name in model.parameters() | inherited}
        if model.evidence is not None:
            values |= _evidence(model.evidence)
        units = {key: each.comment for key, each in ABOVE.items()} | {**comments}
        if model.unit == "1":
            units = {key: words.replace("rad", "1") for key, words in units.items()}
        lines += _lines(values, units)
        if joint in servos:
            own = vars(servos[joint])
            values = {name: own[name] for name in SERVO_KEYS} | own["settings"]
            units = {key: each.comment for key, each in SERVO_KEYS.items()}
            lines += ["", f"[{key_name((joint,))}.servo]", *_lines(values, units)]
        blocks.append(lines)
    blocks += [[f"[leg.{key_name((name,))}]", *_lines(table)] for name, table in legs.items()]
    return "\n\n".join("\n".join(lines) for lines in blocks if lines) + "\n"


def has_content(path: Path | str) -> bool:
    """Whether there is a file that is not empty; not on standard output, ``-``."""
    return str(path) != "-" and Path(path).is_file() and Path(path).stat().st_size > 0


def _comment(text: str) -> str:
    """A comment on one line, without characters that TOML forbids."""
    return "# " + "".join(mark if mark.isprintable() else " " for mark in text)


def _lines(values: Mapping[str, Any], comments: Mapping[str, str] = {}) -> list[str]:
    """Keys and their values, with their comments."""
    return [
        f"{key} = {toml_value(value)}" + (f"  {_comment(words)}" if words else "")
        for key, value in values.items()
        for words in [comments.get(key, "")]
    ]


def _evidence(evidence: Evidence) -> dict[str, Any]:
    """The known evidence of a model by key: its test, verdict, intervals and correlations."""
    known = dict[str, Any]()
    for key, field in EVIDENCE.items():
        value = getattr(evidence, field)
        if not isinstance(value, str):
            numbers = np.array(value, dtype=float)  # NaN for None
            value = numbers.tolist() if numbers.size and np.isfinite(numbers).all() else ""
        if value != "":
            known[key] = value
    correlations = {key: known.pop(key) for key in ("correlations",) if key in known}
    intervals = {f"{name}_interval": ends for name, ends in evidence.intervals.items()}
    return {**known, **intervals, **correlations}


def _model(
    file: Toml, keys: Mapping[str, Any], own: Mapping[str, Any], table: str = ""
) -> JointModel:
    """The model of these keys, with the evidence in its own keys."""
    wrong = partial(file.fault, table=(table,) if table else ())
    if missing := [key for key in REQUIRED if key not in keys]:
        raise wrong(f"no {', '.join(missing)}; expected {', '.join(REQUIRED)} in rad/s, rad, s, s")
    times = [keys[key] for key in ("lag", "acceleration_time")]
    slowest = 10.0  # no servo takes so long to answer a request [s]: the unit is another
    if all(isinstance(time, int | float) for time in times) and sum(times) > slowest:
        raise wrong(
            f"lag + acceleration_time: got {sum(times):g} s, expected at most {slowest:g} s; 32 ms "
            "are 0.032 (v_max is in rad/s, theta_0 in rad)"
        )
    try:
        model = JointModel(**{key: keys[key] for key in PARAMETER_UNITS if key in keys})
    except InvalidModel as error:
        raise wrong(error, key=str(error).partition(":")[0]) from error
    doubtful = [
        f"{name} = {value:g} {unit}: is it in degrees? expected at most {most:.4g} {unit}; "
        f"{value:g} {unit.replace('rad', 'deg')} are {name} = {math.radians(value):.4g}"
        for name, value, unit, most in (
            ("v_max", model.v_max, "rad/s", 60.0),  # direct drives reach 40
            ("theta_0", model.theta_0, "rad", math.pi),
        )
        if value > most
    ]
    declared = {key.removesuffix("_interval"): key for key in own if key.endswith("_interval")}
    if doubtful and not declared:  # identify writes them, and radians
        raise wrong("; ".join(doubtful))
    intervals = {}
    for name, key in declared.items():
        value = getattr(model, name)
        ends = own[key] if isinstance(own[key], list) and len(own[key]) == 2 else [math.nan] * 2
        least, most = (as_number(end, infinite=True) for end in ends)
        rounding = 1e-9 * abs(value)
        if not least - rounding <= value <= most + rounding:
            raise wrong(
                f"{key}: got {shown(own[key])}, expected least and largest value "
                f"[{PARAMETER_UNITS.get(name, '1/s')}], with {value:g}, that of the model, between "
                "them; inf or -inf where there is none",
                key=key,
            )
        intervals[name] = (least, most)
    untested = () if "expected_error" in own else TESTED
    evidence = {f: own[key] for key, f in EVIDENCE.items() if key in own and key not in untested}
    evidence |= {"intervals": intervals} if intervals else {}
    try:
        return model.with_evidence(Evidence(**evidence)) if evidence else model
    except InvalidInput as error:
        raise wrong(error) from error


def _legs(file: Toml) -> dict[str, dict[str, Any]]:
    """The tables of legs; none where ``leg`` is a joint."""
    tables: Any = file.content.get("leg")
    is_legs = isinstance(tables, dict) and all(isinstance(each, dict) for each in tables.values())
    return tables if is_legs else {}


def read_legs(path: Path | str) -> dict[str, LegPlace]:
    """The legs of a model file, by name: its tables ``[leg.<name>]``; none where it has none."""
    file = read_toml(path, example='urdf = "robot.urdf"')
    legs = {}
    for name, table in _legs(file).items():
        own = _checked(file, ("leg", name), table, LEG_KEYS, needed=("urdf", "base", "foot"))
        urdf = str(Path(file.path).parent / own["urdf"])
        locked, near = own.get("lock_deg", {}), own.get("near_deg")
        legs[name] = LegPlace(urdf, own["base"], own["foot"], locked, near)
    return legs


def read_bus(path: Path | str) -> dict[str, Any]:
    """Bus, port and baud rate of a model file, where it has them."""
    file = read_toml(path, example='bus = "feetech"')
    own = {key: each for key, each in file.content.items() if not isinstance(each, dict)}
    return _checked(file, (), {key: own[key] for key in BUS if key in own}, BUS)


def read_servos(
    path: Path | str, joints: Sequence[str] | None = None, *, optional: bool = False
) -> dict[str, Servo]:
    """The servos of a model file, of these joints or of all; there may be none if ``optional``."""
    from planner.robot.arm import SETTINGS, Servo  # imports the drivers of the buses

    keys = SERVO_KEYS | dict.fromkeys(SETTINGS, Key(as_whole, "a whole number"))
    file, servos = read_toml(path, example="id = 1"), {}
    for joint, joint_table in file.content.items():
        table = joint_table.get("servo") if isinstance(joint_table, dict) else None
        if not isinstance(table, dict):
            continue
        own = _checked(file, (joint, "servo"), table, keys, needed=("id",))
        settings = {key: own.pop(key) for key in SETTINGS if key in own}
        try:
            servos[joint] = Servo(**own, settings=settings)
        except InvalidInput as error:
            raise file.fault(error, (joint, "servo")) from error
    problem = ""
    if not servos and not optional:
        problem = (
            "no table of a servo; expected tables such as [knee.servo] with id, zero_tick and "
            "direction, as calibrate writes them"
        )
    elif missing := [name for name in joints or () if name not in servos]:
        advice = "calibrate it, or name the columns alike"
        problem = f"no servo of {', '.join(missing)}; servos are of {', '.join(servos)}: {advice}"
    if problem:
        raise InvalidFile(file.path, problem)
    return servos if joints is None else {name: servos[name] for name in joints}


def _checked(
    file: Toml,
    place: Sequence[str],
    table: Mapping[str, Any],
    keys: Mapping[str, Key],
    *,
    needed: Sequence[str] = (),
) -> dict[str, Any]:
    """The values of a table that has the needed keys, no unknown ones, and no unfit values."""
    values = dict[str, Any]()
    for key, value in table.items():
        if key not in keys:
            known = ", ".join(PARAMETER_UNITS if "v_max" in keys else keys)
            hint = nearest(key, [*keys])
            raise file.fault(f"unknown key '{key}'{hint}; keys: {known}", place, key)
        with suppress(ValueError, OverflowError):
            values[key] = keys[key].fitted(value)
        if values.get(key) is None:
            got = f"{key}: got {shown(value)}, expected {keys[key].words}"
            raise file.fault(got, place, key)
    if missing := [key for key in needed if key not in table]:
        meanings = "; ".join(f"{key} is {keys[key].words}" for key in missing)
        raise file.fault(f"no {', '.join(missing)}; {meanings}", place)
    return values
