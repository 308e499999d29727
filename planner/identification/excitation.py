"""Test signals for a joint: inside its limits, gentle at both ends, the same at every call."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from planner.arrays import MOST_SAMPLES, Array, as_number, as_whole, freeze, shown
from planner.exceptions import InvalidInput, angle_text
from planner.identification.identify import identify
from planner.identification.log import Log
from planner.identification.result import Identification
from planner.model.joint import JointModel
from planner.model.response import simulate

PARTS = (
    ("slow_triangle", 0.4, "dead band, static sag, sag by the angle"),
    ("multisine", 0.4, "v_max / theta_0, lag, acceleration time, time constant"),
    ("steps", 0.2, "top speed, theta_0, acceleration limit, delay of jumps"),
)
"""Of each half of the combined signal: kinds, their shares, what each makes identifiable."""

SWELL = 0.08  # share of a sum of sines in which it, or one of its sines, swells


class Part(NamedTuple):
    """A part of a combined signal."""

    name: str
    begin: float  # [s]
    end: float  # [s]
    determines: str  # what it makes identifiable


@dataclass(frozen=True, kw_only=True)
class Excitation:
    """Requests to play on a joint, which must be at ``centre`` before the first."""

    kind: str  # as in :func:`excite`
    times: Array  # of the requests, from 0 [s], (n,)
    requests: Array  # [rad], (n,); the first and the last are the centre
    period: float  # time between requests [s]
    centre: float  # where the signal begins and ends [rad]
    amplitudes: tuple[float, ...] = ()  # heights of the step tests [rad]; empty for kinds without
    parts: tuple[Part, ...] = ()  # of the combined signal, in their order

    @property
    def largest_jump(self) -> float:
        """Largest change from one request to the next [rad]."""
        return float(np.max(np.abs(np.diff(self.requests))))


def step_test(amplitude: float, *, samples: int = 88) -> Array:
    """Requests of one cycle of the step test: ``amplitude`` for the first half, 0 for the second.

    Args:
        amplitude: theta_test of Equation 1 [rad].
        samples: Requests in one cycle, t_step of the paper; even, at least 2.

    Returns:
        Requests [rad], shape (samples,).

    Raises:
        InvalidInput: The amplitude is not finite, or the cycle cannot be halved.

    Example:
        >>> import numpy as np
        >>> np.degrees(step_test(0.5, samples=8)).round(1)
        array([28.6, 28.6, 28.6, 28.6,  0. ,  0. ,  0. ,  0. ])
    """
    angle = as_number(amplitude)
    if math.isnan(angle):
        raise InvalidInput(f"amplitude: got {shown(amplitude)}, expected a finite angle [rad]")
    count = as_whole(samples) or 0
    if not 2 <= count <= MOST_SAMPLES or count % 2:
        raise InvalidInput(
            f"samples: got {shown(samples)}, expected an even number, 2 to {MOST_SAMPLES}"
        )
    requests = np.zeros(count)
    requests[: count // 2] = angle
    requests.setflags(write=False)
    return requests


def excite(
    kind: str,
    *,
    limits: tuple[float, float],  # least and largest request [rad]
    period: float,  # between requests [s]
    duration: float,  # of the whole signal [s]
    amplitudes: Sequence[float] = (),  # height theta_test of each step test [rad]
    cycles: int | None = None,  # of each step test
    highest: float | None = None,  # frequency of a sum of sines [Hz]
    seed: int = 0,
) -> Excitation:
    """Make a test signal within the limits that rests in their middle at both ends.

    ``combined`` is a slow triangle, a sum of sines and steps; ``steps`` are those of Equation 1,
    about the middle, and ``multisine``, ``random_steps`` and ``slow_triangle`` the other kinds.
    Steps are by default an eighth, half and the whole of the limits high, each 3 times, or once in
    each half of ``combined``. A sum of sines has by default frequencies up to a tenth of the rate
    of the requests, at most 5 Hz. InvalidInput is raised where one of these cannot be.
    """
    low, high = limits
    if not -math.inf < low < high < math.inf:
        raise InvalidInput(f"limits: got {angle_text(low, high)}, expected the lower one first")
    middle, reach = 0.5 * (low + high), 0.5 * (high - low)
    if not 0.0 < period < math.inf:
        raise InvalidInput(f"period: got {period:g} s, expected more than 0")
    least, most = 40, 1_000_000
    if not least * period <= duration <= most * period:
        raise InvalidInput(
            f"duration: got {duration:g} s, expected {least} to {most} requests of {period:g} s, "
            f"so {least * period:g} to {most * period:g} s"
        )
    samples = round(duration / period)
    rest = max(1, round(min(0.5, 0.1 * duration) / period))  # at either end, shows the offset
    moving = samples - 2 * rest
    fastest = min(5.0, 0.1 / period) if highest is None else highest
    both = kind == "combined"
    # those that follow too soon shake a servo out of step, which no model foretells
    cycles = (1 if both else 3) if cycles is None else cycles
    if cycles < 1:
        raise InvalidInput(f"cycles: got {cycles}, expected 1 or more")
    # by default well inside theta_0 of most joints, and far beyond it
    amplitudes = amplitudes or [2.0 * reach * share for share in (0.125, 0.5, 1.0)]
    for amplitude in amplitudes:
        if not 0.0 < amplitude <= 2.0 * reach * (1.0 + 1e-12):
            raise InvalidInput(
                f"amplitudes: got a step of {angle_text(amplitude)}, expected more than 0 and at "
                f"most {angle_text(2.0 * reach)}, what the limits allow about the centre"
            )
    tests = [height / (2.0 * reach) for height in amplitudes]
    make: Mapping[str, Callable[[int, int], Array]] = {  # of a length, with a seed
        "steps": lambda n, _: _steps(n, tests, cycles),
        "multisine": lambda n, own: _multisine(n, period, fastest, own, quickens=both),
        "random_steps": lambda n, own: _random_steps(n, period, own),
        "slow_triangle": lambda n, _: _slow_triangle(n, 1 if both else 2),
    }
    if kind not in make and not both:
        raise InvalidInput(f"kind: got '{kind}', expected combined or one of {', '.join(make)}")
    parts = 2 * PARTS if both else ((kind, 2.0, ""),)
    ends = np.round(0.5 * moving * np.cumsum([0.0, *(share for _, share, _ in parts)])).astype(int)
    halves, share = 2 * cycles * len(tests), 0.5 * PARTS[-1][1] if both else 1.0
    lengths = np.diff(ends).tolist()
    if any(
        name == "steps" and n < 2 * halves for (name, *_), n in zip(parts, lengths, strict=True)
    ):
        moves = period * ((2 * halves + 1) / share + 2)  # with room for rounding
        enough = math.ceil(100.0 * min(moves + 1.0, moves / 0.8)) / 100.0  # with the rests
        words = f"expected more, such as {enough:g} s, for {halves} half cycles of step tests"
        raise InvalidInput(f"duration: got {duration:g} s, {words}; or ask for fewer of them")
    deflection = np.concatenate(
        [
            make[name](length, 2 * seed + k // len(PARTS) if both else seed)
            for k, ((name, _, _), length) in enumerate(zip(parts, lengths, strict=True))
        ]
    )
    # rounding may not leave the limits
    requests = np.clip(middle + reach * np.pad(deflection, rest), *limits)
    times = np.arange(samples, dtype=np.float64) * period
    edges = (period * (rest + ends)).tolist()
    names = {"multisine": "sum of sines"}
    freeze(times, requests)
    return Excitation(
        kind=kind,
        times=times,
        requests=requests,
        period=period,
        centre=middle,
        amplitudes=tuple(map(float, amplitudes)) if both or kind == "steps" else (),
        parts=tuple(
            Part(names.get(name, name.replace("_", " ")), begin, end, determines)
            for (name, _, determines), begin, end in zip(parts, edges[:-1], edges[1:], strict=True)
            if both
        ),
    )


def _steps(samples: int, shares: Sequence[float], cycles: int) -> Array:
    """Step tests of Equation 1 about 0, one height after the other, as shares of the range."""
    half = samples // (2 * cycles * len(shares))
    tests = [np.tile(step_test(2.0 * share, samples=2 * half) - share, cycles) for share in shares]
    made = np.concatenate(tests)
    return np.append(made, np.zeros(samples - len(made)))


def _multisine(
    samples: int, period: float, highest: float, seed: int, *, quickens: bool = False
) -> Array:
    """A sum of sines of random phase, low ones larger, that swells and dies down.

    Of 64 draws of the phases the one with the lowest peak is kept. Where it quickens it begins with
    the slowest third of the sines, and the faster another is the later it joins them: with all of
    them at once no part is slower than the fastest sine.
    """
    most = max(1, int(highest * samples * period))
    cycles = np.geomspace(min(2, most), most, 12)  # in the whole signal
    waves = np.unique(np.round(cycles))
    shares = np.arange(samples) / samples
    joins = np.linspace(-1.0 / 3.0, 2.0 / 3.0, len(waves)) if quickens else -np.ones(len(waves))
    present = _risen((shares - joins[:, None]) / SWELL + (joins[:, None] <= 0.0))
    amplitudes = waves[:, None] ** -0.5 * present
    swell = _risen(np.minimum(shares, 1.0 - shares) / SWELL)
    amplitudes *= swell / np.linalg.norm(amplitudes, axis=0)
    angles = 2.0 * np.pi * np.outer(waves, shares)
    drawn = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, (64, len(waves)))
    made = [np.sum(amplitudes * np.sin(angles + phases[:, None]), axis=0) for phases in drawn]
    flattest = min(made, key=lambda signal: float(np.max(np.abs(signal)) / np.std(signal)))
    scaled: Array = flattest / np.max(np.abs(flattest))
    return scaled


def _random_steps(samples: int, period: float, seed: int) -> Array:
    """Levels drawn evenly between -1 and 1.

    Each is held for 0.12 s, a hobby servo's lag and acceleration time, to 0.9 s, in which it
    arrives.
    """
    draw = np.random.default_rng(seed)
    made = np.zeros(samples)
    start = 0
    while start < samples:
        dwell = np.exp(draw.uniform(np.log(0.12), np.log(0.9)))
        end = start + max(2, round(dwell / period))
        made[start:end] = draw.uniform(-1.0, 1.0)
        start = end
    return made


def _slow_triangle(samples: int, cycles: int) -> Array:
    """To and fro at constant speeds, so many cycles far in one half, and near in the other."""
    parts = []
    for height, part in zip((1.0, 0.25), np.array_split(np.empty(samples), 2), strict=True):
        phase = np.mod(cycles * np.arange(len(part)) / len(part) + 0.75, 1.0)
        parts.append(height * (4.0 * np.abs(phase - 0.5) - 1.0))
    return np.concatenate(parts)


def _risen(shares: Array) -> Array:
    """Half a cosine from 0 to 1, which it keeps."""
    risen: Array = 0.5 - 0.5 * np.cos(np.pi * np.clip(shares, 0.0, 1.0))
    return risen


def expect(
    excitation: Excitation,
    model: JointModel,
    *,
    noise: float = math.radians(0.2),  # standard deviation of the measured angles [rad]
    resolution: float = math.radians(0.3),  # step of the sensor [rad]
) -> Identification:
    """Identify the expected joint, at any rate, from what it would answer to the signal.

    Its intervals are those to expect from the robot, as far as the robot is like the model.
    """
    joint = model.requested_every(excitation.period)
    random = np.random.default_rng(0).standard_normal(len(excitation.requests))
    angles = simulate(joint, excitation.requests, cyclic=False) + noise * random
    log = Log(
        times=excitation.times,
        requests=excitation.requests,
        angles=resolution * np.round(angles / resolution),
        name=f"simulated {excitation.kind}",
        unit=model.unit,
    )
    return identify(log, tick=joint.tick, hold=joint.hold, hold_out=False)
