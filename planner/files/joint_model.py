"""Joint models as TOML: the fields of JointModel in SI, for every joint or in a table per joint."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass, fields
from pathlib import Path
from typing import Any

from planner.exceptions import InvalidFile, InvalidModel
from planner.files.table import nearest
from planner.files.text import write_text
from planner.files.toml import Toml, read_toml
from planner.model.joint import JointModel

FIELDS = tuple(field.name for field in fields(JointModel))
REQUIRED = tuple(field.name for field in fields(JointModel) if field.default is MISSING)


@dataclass(frozen=True)
class ModelFile:
    """Models of joints: one for all, one for each, or both.

    Attributes:
        path: Where they came from.
        common: The model of every joint without a table of its own; None where there is none.
        by_joint: The models of single joints.
    """

    path: str
    common: JointModel | None
    by_joint: Mapping[str, JointModel]

    def for_joints(self, names: Sequence[str]) -> tuple[JointModel, ...]:
        """The model of each named joint.

        Raises:
            InvalidFile: A joint has no model, or a table was meant for one but is misspelt.
        """
        return tuple(self._for_joint(name, names) for name in names)

    def _for_joint(self, name: str, names: Sequence[str]) -> JointModel:
        if name in self.by_joint:
            return self.by_joint[name]
        spare = [table for table in self.by_joint if table not in names]
        hint = nearest(name, spare)
        if self.common is None or hint:
            tables = ", ".join(f"[{table}]" for table in self.by_joint) or "none"
            raise InvalidFile(
                self.path,
                f"no table for the joint '{name}'{hint}; tables: {tables}; add [{name}], or write "
                "the parameters above all tables to have them for every joint",
            )
        return self.common


def read_models(path: Path | str) -> ModelFile:
    """Read joint models from TOML, or from standard input for ``-``.

    Keys above all tables hold for every joint; a table ``[knee]`` sets or changes some for one.

    Raises:
        InvalidFile: Not TOML, an unknown or missing key, or parameters that describe no joint.
    """
    return models_of(read_toml(path, example="v_max = 5.45"))


def models_of(file: Toml) -> ModelFile:
    """Understand TOML as joint models; see :func:`read_models`."""
    path, content = file.path, file.content
    common = {key: value for key, value in content.items() if not isinstance(value, dict)}
    tables = {key: value for key, value in content.items() if isinstance(value, dict)}
    for table, keys in ((None, common), *tables.items()):
        for key in keys:
            _check_key(file, key, table)
    by_joint = {
        table: _model(path, {**common, **own}, f"table [{table}]: ")
        for table, own in tables.items()
    }
    complete = not tables or all(key in common for key in REQUIRED)
    return ModelFile(path, _model(path, common, "") if complete else None, by_joint)


def write_model(path: Path | str, model: JointModel) -> None:
    """Write one model for every joint as TOML, each key with its unit; ``-`` is standard output."""
    write_text(path, models_text({"": model}))


def models_text(
    models: Mapping[str, JointModel],
    *,
    remarks: Sequence[str] = (),
    about: Mapping[str, Mapping[str, str]] | None = None,
) -> str:
    """Models as TOML that :func:`read_models` reads, with comments.

    Args:
        models: By joint, a table for each; the joint "" stands above all tables.
        remarks: Comments at the top.
        about: By joint, comments by key that take the place of the key's unit, and under "" one
            above the joint's keys.
    """
    blocks = ["\n".join(_comment(remark) for remark in remarks)] if remarks else []
    for joint, model in models.items():
        said = (about or {}).get(joint, {})
        lines = [f"[{_key(joint)}]"] if joint else []
        lines += [_comment(line) for line in said.get("", "").splitlines()]
        lines += [
            f"{field.name} = {getattr(model, field.name)!r}  "
            + _comment(said.get(field.name, f"[{field.metadata.get('unit', '-')}]"))
            for field in fields(model)
        ]
        blocks.append("\n".join(lines))
    return "\n\n".join(blocks) + "\n"


def _comment(text: str) -> str:
    """A comment on one line, without what TOML forbids in it."""
    return "# " + "".join(mark if mark.isprintable() else " " for mark in text)


def _key(joint: str) -> str:
    """The joint as a key of TOML, in quotes where it needs them."""
    if re.fullmatch(r"[A-Za-z0-9_-]+", joint):
        return joint
    return json.dumps(joint, ensure_ascii=False).replace("\x7f", "\\u007f")


def _model(path: Path | str, keys: Mapping[str, Any], place: str) -> JointModel:
    missing = [key for key in REQUIRED if key not in keys]
    if missing:
        raise InvalidFile(
            path,
            f"{place}no {', '.join(missing)}; expected {', '.join(REQUIRED)} in rad/s, rad, s, s",
        )
    try:
        return JointModel(**keys)
    except InvalidModel as error:
        raise InvalidFile(path, f"{place}{error}") from error


def _check_key(file: Toml, key: str, table: str | None) -> None:
    if key in FIELDS:
        return
    place = f" in [{table}]" if table is not None else ""
    raise InvalidFile(
        file.path,
        f"unknown key '{key}'{place}{nearest(key, FIELDS)}; keys: {', '.join(FIELDS)}",
        line=file.line_of((key,) if table is None else (table, key)),
    )
