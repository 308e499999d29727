"""The battery: its voltage falls with the current drawn, and wanders a little."""

from __future__ import annotations

import math

import numpy as np

from planner.virtual.constants import Constants


class Supply:
    """A voltage behind a resistance, with slow noise that repeats for a seed."""

    def __init__(self, constants: Constants, random: np.random.Generator) -> None:
        """A supply from which nothing is drawn yet."""
        self._constants = constants
        self._random = random
        self._wander = 0.0
        self._keep = math.exp(-constants.control_period / constants.supply_memory)
        self._fresh = constants.supply_noise * math.sqrt(1.0 - self._keep**2)

    def voltage(self, drawn: float) -> float:
        """Voltage one control period later while so much current [A] is drawn [V]."""
        self._wander = self._keep * self._wander + self._fresh * self._random.standard_normal()
        constants = self._constants
        return constants.battery_voltage + self._wander - constants.battery_resistance * drawn
