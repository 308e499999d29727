"""Stand-ins for the large packages that LeRobot imports and these tests do not need.

Any attribute of such a package is a class that can be subclassed, called and used as a decorator.
``torch.Tensor`` is a NumPy array with the few methods that the tests use.
"""

from __future__ import annotations

import importlib.abc
import importlib.machinery
import sys
import types
from typing import Any

import numpy as np

HEAVY = (
    *("accelerate", "av", "datasets", "diffusers", "jsonlines", "pandas", "pyarrow", "pynput"),
    *("rerun", "safetensors", "torch", "torchcodec", "torchvision", "transformers", "wandb"),
)


class _Names(type):
    def __getattr__(cls, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        made = _Names(name, (), {"__init__": lambda self, *_, **__: None, "__call__": _call})
        setattr(cls, name, made)
        return made

    def __or__(cls, other: Any) -> Any:
        return cls

    __ror__ = __or__


def _call(self: Any, *given: Any, **_: Any) -> Any:
    return given[0] if len(given) == 1 and callable(given[0]) else self


class Tensor(np.ndarray):
    """An array that answers to what PyTorch calls a few things."""

    device = "cpu"

    def detach(self) -> Tensor:
        return self

    def cpu(self) -> Tensor:
        return self


def as_tensor(data: Any, dtype: Any = None, device: Any = None) -> Tensor:
    return np.asarray(data, dtype=dtype).view(Tensor)


class _StandIn(types.ModuleType):
    __path__ = ()

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        made = getattr(_Names("names", (), {}), name)
        setattr(self, name, made)
        return made


class _Finder(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    def find_spec(self, name: str, path: Any = None, target: Any = None) -> Any:
        if name.partition(".")[0] in HEAVY:
            return importlib.machinery.ModuleSpec(name, self, is_package=True)
        return None

    def create_module(self, spec: Any) -> types.ModuleType:
        module = _StandIn(spec.name)
        if spec.name == "torch":
            module.Tensor, module.as_tensor, module.tensor = Tensor, as_tensor, as_tensor
        return module

    def exec_module(self, module: types.ModuleType) -> None:
        pass


def install() -> None:
    """Let the stand-ins be imported; before LeRobot is."""
    if not any(isinstance(each, _Finder) for each in sys.meta_path):
        sys.meta_path.insert(0, _Finder())
