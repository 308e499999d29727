"""A JointTrajectory as YAML, as ``ros2 topic pub`` takes it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from planner.exceptions import MissingExtra
from planner.files.text import write_text


def write_trajectory_yaml(path: Path | str, message: Mapping[str, Any]) -> None:
    """Write what :func:`joint_trajectory` makes to a file, or to standard output for ``-``.

    Raises:
        MissingExtra: PyYAML is not installed.
        InvalidFile: The file cannot be written.
    """
    write_text(path, trajectory_yaml(message))


def trajectory_yaml(message: Mapping[str, Any]) -> str:
    """The message's text, by PyYAML, with which ROS reads it.

    Names such as ``on`` are then quoted where YAML 1.1 would take them for something else.
    """
    try:
        import yaml
    except ImportError as error:
        raise MissingExtra("a trajectory as YAML", "yaml") from error
    dumper = getattr(yaml, "CSafeDumper", yaml.SafeDumper)  # in C where there is one
    text: str = yaml.dump(
        dict(message),
        Dumper=dumper,
        default_flow_style=None,  # a line for a row of numbers
        sort_keys=False,
        allow_unicode=True,
        width=10**6,
    )
    return text
