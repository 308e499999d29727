"""Which of a log's joints to read."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from planner.exceptions import InvalidFile
from planner.files.logs.options import ALL_JOINTS
from planner.files.table import nearest


def choose_joints(path: Path | str, joints: Sequence[str], wanted: str | None) -> tuple[int, ...]:
    """Places of the joints to read among ``joints``.

    Args:
        path: The file, for the error.
        joints: Names of its joints; "" where it names none.
        wanted: The name to read, "all", or None where there is only one to choose.

    Raises:
        InvalidFile: No joint of this name, or several without a choice.
    """
    if wanted == ALL_JOINTS and wanted not in joints:
        return tuple(range(len(joints)))
    names = ", ".join(joint or "(one without a name)" for joint in joints)
    if wanted is None:
        if len(joints) == 1:
            return (0,)
        raise InvalidFile(
            path, f"{len(joints)} joints ({names}); choose one with --joint NAME, or --joint all"
        )
    if wanted not in joints:
        raise InvalidFile(path, f"no joint '{wanted}'{nearest(wanted, joints)}; joints: {names}")
    return (list(joints).index(wanted),)
