"""LeRobot without its large packages."""

import importlib.util

import pytest

if importlib.util.find_spec("lerobot") is None:
    pytest.skip(
        "LeRobot is not installed: scripts/lerobot makes an environment with it",
        allow_module_level=True,
    )

import heavy

heavy.install()
