"""The second answer: Equation 3 written out once more, against the model that plans rely on."""

from __future__ import annotations

import ast
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from planner.evaluation import independent
from planner.evaluation.checks import AGREEMENT
from planner.evaluation.independent import independent_angles, next_cycle
from planner.model.joint import JointModel
from planner.model.response import simulate
from tests.instances import random_model, saturating
from tests.strategies import models, trajectories


def _apart(one, other):
    return float(np.max(np.abs(one - other)))


def _load(samples):
    return np.random.default_rng(samples).uniform(-1.0, 1.0, samples)


@given(models(friction=True), trajectories(), st.none() | st.floats(-2.0, 2.0))
def test_from_rest_it_agrees_for_any_joint(model, requests, start):
    load = _load(len(requests))
    angles = simulate(model, requests, cyclic=False, start=start, load=load)
    second = independent_angles(model, requests, cyclic=False, start=start, load=load)
    assert _apart(angles, second) <= AGREEMENT.value


@given(models(friction=True), trajectories())
def test_the_cycle_that_the_model_finds_is_one(model, requests):
    load = _load(len(requests))
    angles = simulate(model, requests, load=load)
    assert _apart(next_cycle(model, requests, angles[-1], load), angles) <= AGREEMENT.value


@given(models(friction=True), trajectories())
def test_the_cycle_that_it_finds_itself_is_one(model, requests):
    load = _load(len(requests))
    angles = independent_angles(model, requests, cyclic=True, load=load)
    assert _apart(next_cycle(model, requests, angles[-1], load), angles) <= AGREEMENT.value


@pytest.mark.parametrize("seed", range(12))
def test_where_there_is_one_cycle_both_find_it(seed):
    rng = np.random.default_rng(seed)
    model = random_model(rng, whole=seed % 2 == 0, hold=1 + seed % 4, offset=True)
    requests = 0.5 * saturating(rng, model)
    second = independent_angles(model, requests, cyclic=True)
    assert _apart(simulate(model, requests), second) <= AGREEMENT.value


def test_a_cycle_that_closes_slowly_is_found():
    # A tick corrects the angle by v_max / theta_0 = 1/5000, a cycle by less than a hundredth.
    model = JointModel(v_max=0.01, theta_0=0.5, lag=0.02, acceleration_time=0.03, tick=0.01)
    requests = 0.2 + 0.2 * np.sin(2.0 * np.pi * np.arange(40) / 40)
    second = independent_angles(model, requests, cyclic=True)
    assert _apart(simulate(model, requests), second) <= AGREEMENT.value


@pytest.mark.parametrize(
    "change",
    [
        {"lag": 0.033},
        {"acceleration_time": 0.049},
        {"theta_0": 0.1222},
        {"offset": 1e-6},
        {"v_max": 5.46},
        {"dead_band": 1e-6},
        {"v_offset": 0.005},
    ],
    ids=str,
)
def test_a_model_that_differs_little_is_distinguished(change):
    model = JointModel.ers210a()
    requests = 0.4 * np.sin(2.0 * np.pi * np.arange(88) / 88)
    second = independent_angles(replace(model, **change), requests, cyclic=True)
    assert _apart(simulate(model, requests), second) > 100.0 * AGREEMENT.value


def test_it_shares_no_code_with_the_model_that_it_judges():
    tree = ast.parse(Path(independent.__file__).read_text(encoding="utf-8"))
    names = {
        alias.name
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and str(node.module).startswith("planner")
        for alias in node.names
    }
    assert names == {"JointModel", "Array"}
    read = {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
    assert not read & {"window", "v_max_per_tick", "lag_ticks", "acceleration_ticks"}
