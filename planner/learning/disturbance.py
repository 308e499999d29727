"""The disturbance: the model's error in measured cycles, less noise and delay.

The disturbance ``d = mean measured - modelled angles`` repeats from cycle to cycle, the noise does
not. Its spectrum is shrunk as by a Wiener filter: where the noise, by its variance between the
cycles, explains all of it, nothing is learnt.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import fft

from planner.model.joint import JointModel
from planner.trajectory import Array

Spectrum = npt.NDArray[np.complex128] | Array


@dataclass(frozen=True, kw_only=True)
class FilterOptions:
    """How much of a disturbance is learnt.

    Attributes:
        noise: Multiple of the noise's power that is taken off the spectrum [-]. A periodogram
            averaged over a few frequencies exceeds its mean by that much now and then.
        neighbours: Frequencies on either side over which a power is averaged.
        noise_neighbours: The same for the variance between cycles, of which there are few.
        latency_error: Share of the model's latency by which it may be wrong [-]. What is learnt
            falls with the cosine of the phase error that this makes, and is nothing from a quarter
            of a period on: from there a correction by the model could make the error larger.
    """

    noise: float = 2.0
    neighbours: int = 2
    noise_neighbours: int = 4
    latency_error: float = 0.3


OPTIONS = FilterOptions()


def to_spectrum(rows: Array, *, cyclic: bool) -> Spectrum:
    """Orthonormal spectrum along axis -2: Fourier of a cycle, cosines of a motion from rest.

    White noise of variance s^2 has the mean power s^2 at every frequency.
    """
    if cyclic:
        return np.asarray(fft.rfft(rows, norm="ortho", axis=-2))
    return np.asarray(fft.dct(rows, norm="ortho", axis=-2))


def from_spectrum(spectrum: Spectrum, samples: int, *, cyclic: bool) -> Array:
    """The rows of a spectrum: the inverse of :func:`to_spectrum`."""
    if cyclic:
        return np.asarray(fft.irfft(spectrum, samples, norm="ortho", axis=-2))
    return np.asarray(fft.idct(spectrum, norm="ortho", axis=-2))


def noise_of(trials: Sequence[Array], error: Array, *, cyclic: bool) -> Array:
    """Power of the noise of one measured cycle at every frequency [rad^2], (f, k).

    It is the larger of two powers: of the variance between cycles, and of frequencies above half of
    those that are sampled. There a joint hardly moves: the disturbance is noise, or the steps of a
    sensor, which repeat. Only the second is available where no requests were measured twice.

    Args:
        trials: Measured cycles of each trial [rad], (cycles, n, k).
        error: Disturbance of one cycle, or of the mean of several [rad], (n, k).
        cyclic: Whether these are cycles, or motions from rest.
    """
    powers = np.abs(to_spectrum(error, cyclic=cyclic)) ** 2
    upper = powers[len(powers) // 2 :]
    median = math.log(2.0) if cyclic else 0.4549  # of a power of mean 1, chi-square distributed
    floor = np.broadcast_to(np.median(upper, axis=0) / median, powers.shape)
    spread, freedom = np.zeros_like(powers), 0
    for measured in trials:
        away = measured - measured.mean(axis=0)
        spread += (np.abs(to_spectrum(away, cyclic=cyclic)) ** 2).sum(axis=0)
        freedom += len(measured) - 1
    if not freedom:
        return np.array(floor)
    between = averaged(spread / freedom, OPTIONS.noise_neighbours)
    return np.asarray(np.maximum(between, floor))


def deviation_of(noise: Array) -> Array:
    """Standard deviation of noise of this power, rms over the samples [rad], (k,)."""
    return np.asarray(np.sqrt(noise.mean(axis=0)))


def averaged(powers: Array, neighbours: int) -> Array:
    """Powers averaged over neighbouring frequencies, (f, k)."""
    kernel = np.ones(2 * neighbours + 1)
    count = np.convolve(np.ones(len(powers)), kernel)[neighbours:-neighbours]
    columns = [np.convolve(column, kernel)[neighbours:-neighbours] for column in powers.T]
    return np.column_stack(columns) / count[:, np.newaxis]


def learnt(innovation: Array, noise: Array, models: Sequence[JointModel], *, cyclic: bool) -> Array:
    """The part of an innovation to learn: less noise, and where the models' phase is certain.

    ``F^-1 [cos(min(2 pi f e, pi/2)) max(0, 1 - c N(f) / S(f)) F [innovation]]``, with S the power
    of the innovation, N that of its noise, and e the error that the latency may have.

    Args:
        innovation: Disturbance less the part that is learnt already [rad], (n, k).
        noise: Power of its noise at every frequency [rad^2], (f, k).
        models: The joints.
        cyclic: Whether it repeats.
    """
    spectrum = to_spectrum(innovation, cyclic=cyclic)
    power = averaged(np.abs(spectrum) ** 2, OPTIONS.neighbours)
    tiny = np.finfo(np.float64).tiny
    shrinkage = np.maximum(1.0 - OPTIONS.noise * noise / np.maximum(power, tiny), 0.0)
    count, period = len(innovation), models[0].period
    steps = np.arange(len(spectrum)) / (count if cyclic else 2 * count)
    hertz = steps / period
    late = OPTIONS.latency_error * np.array([model.latency for model in models])
    phase = 2.0 * np.pi * hertz[:, np.newaxis] * late
    trust = np.cos(np.minimum(phase, np.pi / 2.0))
    return from_spectrum(trust * shrinkage * spectrum, len(innovation), cyclic=cyclic)
