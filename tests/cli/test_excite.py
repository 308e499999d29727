"""Test signals at the command line: inside the limits, ready to play, with what they will tell."""

from __future__ import annotations

import json

import numpy as np
import pytest

from planner.identification.excitation import excite

SHORT = ("--limits-deg", "-30:40", "--duration-s", "8", "--rate-hz", "50")


@pytest.mark.parametrize(
    ("kind", "options", "settings"),
    [
        (
            "steps",
            ("--cycles", 2, "--amplitude-deg", 10, "--amplitude-deg", 25),
            {"cycles": 2, "amplitudes": [10.0, 25.0]},
        ),
        ("chirp", ("--highest-hz", 1.5, "--centre-deg", 0), {"highest": 1.5, "centre": 0.0}),
        ("random-steps", ("--seed", 7), {"seed": 7}),
    ],
)
def test_the_signal_is_the_librarys_with_the_same_choices(run, kind, options, settings):
    result = run("excite", "--kind", kind, *SHORT, *options, "--json")
    assert result.exit_code == 0, result.stderr
    for name in {"amplitudes", "centre"} & set(settings):
        settings = {**settings, name: np.radians(settings[name]).tolist()}
    limits = (np.radians(-30.0), np.radians(40.0))
    made = excite(
        kind.replace("-", "_"), limits=limits, period=0.02, duration=8.0, **settings
    ).requests
    given = json.loads(result.stdout)["requests_deg"]
    np.testing.assert_allclose(given, np.degrees(made), rtol=0.0, atol=1e-9)


def test_noise_and_resolution_of_the_expected_log_are_those_asked_for(run, tmp_path):
    columns = []
    for seed in (0, 1):
        file = tmp_path / f"log{seed}.csv"
        ask = ("--noise-deg", 2, "--resolution-deg", 0.75, "--seed", seed, "--expected-log", file)
        assert run("excite", "--kind", "steps", *SHORT, *ask).exit_code == 0
        columns.append(np.loadtxt(file, delimiter=",", skiprows=1)[:, 2])
    first, second = columns
    np.testing.assert_allclose(first, 0.75 * np.round(first / 0.75), rtol=0.0, atol=1e-9)
    assert np.std(first - second) == pytest.approx(2.0 * np.sqrt(2.0), rel=0.15)
