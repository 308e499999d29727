"""Dry friction and load: plans executed on a virtual servo that carries a pendulum."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np

import planner
from benchmark.parts import Options
from benchmark.parts.pairs import errors_of, four_numbers
from benchmark.pendulum import STS3215, Pendulum
from benchmark.table import Table
from kinematics import Leg
from planner.arrays import Array, rms
from planner.virtual.robot import Constants, VirtualRobot

PERIOD = STS3215.request_period  # time between requests [s]
CYCLES = 5  # cycles that are executed; the last one counts
MASSES = (0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4)
"""Masses that the pendulum carries in turn [kg]."""

TURNS = 2.0 * math.pi


def pick(phase: Array) -> Array:
    """Up, wait, half way down, on down, in straight lines [rad]."""
    corners = (0.0, 0.1, 0.3, 0.5, 0.6, 0.9, 1.0)
    return np.interp(phase / TURNS, corners, (0.2, 0.2, 1.3, 1.3, 0.8, 0.2, 0.2))


MOTIONS: Mapping[str, tuple[float, Callable[[Array], Array]]] = {
    "sine, 0.2 Hz": (5.0, lambda phase: 0.8 + 0.5 * np.sin(phase)),
    "sine, 0.5 Hz": (2.0, lambda phase: 0.8 + 0.5 * np.sin(phase)),
    "sine, 1 Hz": (1.0, lambda phase: 0.8 + 0.4 * np.sin(phase)),
    "two sines": (3.0, lambda phase: 0.9 + 0.4 * np.sin(phase) + 0.15 * np.sin(3.0 * phase + 1.0)),
    "pick and place": (4.0, pick),
}
"""Length of the cycle [s], and angle [rad] by its phase."""


class Rig(NamedTuple):
    """A virtual servo with a pendulum, and the description of its load."""

    pendulum: Pendulum
    leg: Leg
    constants: Constants = STS3215

    def robot(self, angle: Array) -> VirtualRobot:
        """The servo at rest at an angle [rad], shape (1,)."""
        model = self.pendulum.model(self.constants)
        robot = VirtualRobot(angle, constants=self.constants, model=model)
        robot.rest(1.0, angle)
        return robot

    def load(self, angles: Array) -> Array:
        """Torque of gravity on the joint [N m], shape (n,), in poses [rad], shape (n,)."""
        return self.leg.load_torques(angles[:, np.newaxis])[:, 0]

    def execute(self, requests: Array, cycles: int = 1) -> tuple[Array, Array]:
        """Sensed and true angles in the last of some cycles [rad], shape (n,), from rest."""
        recording = self.robot(requests[:1]).play(np.tile(requests, cycles)[:, np.newaxis])
        last = len(requests)
        return recording.sensed[-last:, 0], recording.angles[-last:, 0]

    def log(self, requests: Array) -> planner.Log:
        """What the sensor reads under requests, from rest, with the load of these angles."""
        sensed, _ = self.execute(requests)
        times = PERIOD * np.arange(len(requests))
        return planner.Log(times=times, requests=requests, angles=sensed, load=self.load(sensed))


class Answers(NamedTuple):
    """Angles of the joint in the last cycle [rad], shape (n,), by method."""

    desired: Array
    direct: Array
    shift: Array
    four: Array  # the paper's four numbers and a static offset
    friction: Array  # a model without recorded load
    all: Array  # with recorded load
    expected: float  # error of the plan with all terms [rad], rms


def measure(options: Options) -> list[Table]:  # noqa: ARG001
    """Errors on the virtual servo by motion and by the plan's model."""
    rig = make_rig()
    models = fit_models(rig)
    table = Table(
        "Plans for a virtual servo with friction and a load",
        "motion | direct | time shift | four numbers | load unknown | load known"
        " | over four numbers, % | expected error",
        note="Root mean square of the error in the fifth cycle on a simulated Feetech STS3215 with "
        "a pendulum, mrad, and the error to expect that the last plan tells. The models are fitted "
        "to one log of 74 s.",
    )
    for name in MOTIONS:
        answers = play(rig, name, models)
        errors = [1e3 * rms(each - answers.desired) for each in answers[1:-1]]
        table.add(name, *errors, 100.0 * errors[-1] / errors[2], 1e3 * answers.expected)
    return [table, between_loads()]


def between_loads() -> Table:
    """Models fitted at the lightest and the heaviest of eight masses, on the six between."""
    requests = excitation()[: round(22.0 / PERIOD)]
    logs = [make_rig(Pendulum(mass=mass)).log(requests) for mass in MASSES]
    table = Table(
        "Models of a virtual servo fitted at its lightest and heaviest load, at other loads",
        "mass, kg | load unknown | load known",
        note=f"Root mean square error, degrees. Fitted to 22 s each with {MASSES[0]:g} and "
        f"{MASSES[-1]:g} kg at 0.2 m.",
    )
    ends = logs[0], logs[-1]
    models = [
        planner.identify(fitted, hold_out=False).model
        for fitted in ([replace(log, load=None) for log in ends], ends)
    ]
    for mass, log in zip(MASSES[1:-1], logs[1:-1], strict=True):
        table.add(f"{mass:g}", *(math.degrees(errors_of(model, log)[0]) for model in models))
    return table


def make_rig(pendulum: Pendulum | None = None) -> Rig:
    """The servo and its pendulum."""
    pendulum = pendulum or Pendulum()
    with TemporaryDirectory() as folder:
        urdf = Path(folder) / "pendulum.urdf"
        urdf.write_text(pendulum.urdf(), encoding="utf-8")
        return Rig(pendulum, Leg.from_urdf(urdf, base="base", foot="tip"))


def fit_models(rig: Rig) -> list[planner.JointModel]:
    """Models from a log of the servo: of four numbers, without recorded load, with it."""
    loaded = rig.log(excitation())
    log = replace(loaded, load=None)
    return [four_numbers([log]), planner.identify(log).model, planner.identify(loaded).model]


def excitation() -> Array:
    """A slow triangle, steps, and a sum of sines, twice [rad]."""
    random = np.random.default_rng(5)
    parts = ((0.4, 0.25), (0.25, 0.6), (0.15, 1.1), (0.1, 1.9))
    pieces = []
    for half in range(2):
        triangle = np.interp(np.arange(750), (0, 188, 563, 750), (0.8, 1.9, -0.3, 0.8))
        steps = np.repeat(random.uniform(-0.3, 1.9, 7), 50)
        times = PERIOD * np.arange(750 * half, 750 * (half + 1))
        sines = sum(a * np.sin(TURNS * f * times + k) for k, (a, f) in enumerate(parts))
        pieces += [triangle, steps, 0.8 + sines]
    return np.concatenate(pieces)


def play(rig: Rig, name: str, models: Sequence[planner.JointModel]) -> Answers:
    """Execute the plans of a motion, the desired angles, and these early."""
    length, motion = MOTIONS[name]
    count = round(length / PERIOD)
    desired = motion(TURNS * np.arange(count) / count)
    _, direct = rig.execute(desired, CYCLES)
    leads = [np.roll(direct, -lead) for lead in range(count)]
    shift = min(leads, key=lambda early: rms(early - desired))
    executed = []
    for model in models:
        plan = planner.plan(model, desired, load=rig.leg.load_torques)
        executed.append(rig.execute(plan.requests[:, 0], CYCLES)[1])
    return Answers(desired, direct, shift, *executed, expected=float(plan.expected_rms[0]))


def draw(file: Path) -> None:
    """The picture of ``docs/friction.md``: one motion, by the plan's model."""
    import matplotlib.pyplot as plt

    rig = make_rig()
    answers = play(rig, "pick and place", fit_models(rig))
    times = PERIOD * np.arange(len(answers.desired))
    curves = {
        "desired angles sent": (answers.direct, "#8a4b9f"),
        "plan, four numbers": (answers.four, "#c25d00"),
        "plan, friction and load": (answers.all, "#0067a8"),
    }
    figure, (above, below) = plt.subplots(
        2, figsize=(7.5, 5.0), sharex=True, layout="constrained", height_ratios=(3, 2)
    )
    above.plot(times, np.degrees(answers.desired), color="#15181c", ls="--", label="desired")
    for name, (angles, colour) in curves.items():
        above.plot(times, np.degrees(angles), color=colour, label=name)
        if angles is not answers.direct:
            below.plot(times, np.degrees(angles - answers.desired), color=colour)
    below.axhline(0.0, color="#15181c", lw=0.8)
    above.set(ylabel="angle [deg]")
    below.set(xlabel="time [s]", ylabel="error [deg]")
    for axes in (above, below):
        axes.spines[["top", "right"]].set_visible(False)
    above.legend(frameon=False)
    figure.savefig(file, metadata={"Date": None})
    plt.close(figure)


if __name__ == "__main__":
    draw(Path(sys.argv[1]))
