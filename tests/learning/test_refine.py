"""Learning from executed cycles: errors fall to the floor, noise and delays are not learnt."""

import math
from dataclasses import replace

import numpy as np
import pytest
from benchmark.plants import MadeJoint, random_joint, random_path

import planner
from planner.arrays import Array, rms
from planner.learning import refine as refining
from planner.learning.trials import Trial
from tests.instances import ERS210A

ENCODER_STEP = 2.0 * math.pi / 4096.0
"""Errors up to this count as none, (12b) of ``docs/math.md`` [rad]."""

PHASE = 2.0 * np.pi * np.arange(88) / 88


def learnt(
    joint: MadeJoint, desired: Array, trials: int, *, reidentify: bool = True
) -> tuple[list[float], planner.Inversion]:
    """True errors of the trials [rad], and the plan after them."""
    plan = planner.invert_optimal(ERS210A, desired, cyclic=joint.cyclic)
    errors = []
    for _ in range(trials):
        true, sensed = joint.play(plan.requests)
        errors.append(rms(true - desired))
        plan = planner.refine(plan, sensed, reidentify=reidentify)
    return errors, plan


@pytest.mark.parametrize("seed", [3, 9])
def test_five_cycles_bring_a_joint_that_is_not_the_model_to_its_floor(seed: int) -> None:
    """30 % off, with friction, gravity, speeds that differ: 1.5 times bound plus noise."""
    joint = random_joint(seed)
    desired = random_path(seed, 88, span=1.2, fastest=(0.03, 0.06)[seed % 2])
    errors, _ = learnt(joint, desired, 5)
    bound = planner.lower_bound(joint.model, desired, load=np.zeros(88))
    noise = math.hypot(joint.noise, joint.count / math.sqrt(12.0))
    assert min(errors) < 1.5 * math.hypot(bound, noise)
    assert min(errors) < errors[0]


def test_noise_alone_is_not_learnt() -> None:
    """On the model itself with noise, the requests hardly change, and learning stops."""
    desired = random_path(1, 88, span=1.0, fastest=0.03)
    plan = planner.invert_optimal(ERS210A, desired)
    joint = MadeJoint(ERS210A, noise=math.radians(0.3), seed=4)
    _, sensed = joint.play(plan.requests, 5)
    after = planner.refine(plan, sensed)
    assert rms(after.disturbance) < 0.25 * math.radians(0.3) / math.sqrt(5.0)
    assert after.learning.noise[0] == pytest.approx(math.radians(0.3), rel=0.25)


@pytest.mark.parametrize("cyclic", [True, False])
def test_the_noise_of_one_measured_motion_is_known_from_its_high_frequencies(cyclic) -> None:
    """Whatever the model misses below: the median of 200 powers is good to a tenth."""
    rng = np.random.default_rng(2)
    phase = np.linspace(0.0, 4.0 * np.pi, 400, endpoint=False)
    plan = planner.invert_optimal(ERS210A, 0.3 - 0.3 * np.cos(phase), cyclic=cyclic)
    spread = math.radians(0.3)
    below = np.outer(np.arange(1, 60), phase / 2.0)
    missed = 0.003 * (np.cos(below + rng.uniform(0.0, 6.3, (59, 1)))).sum(axis=0)
    missed -= 0.0 if cyclic else missed[0]
    measured = plan.predicted + missed + rng.normal(0.0, spread, 400)
    (noise,) = planner.refine(plan, measured, reidentify=False).learning.noise
    assert noise == pytest.approx(spread, rel=0.12)


def test_it_stops_at_the_speed_limit_and_says_so() -> None:
    """The model itself, on a path that is too fast: all of the error is the bound."""
    desired = random_path(2, 88, span=2.0, fastest=0.08)
    plan = planner.invert_optimal(ERS210A, desired)
    after = planner.refine(plan, planner.simulate(ERS210A, plan.requests))
    assert np.array_equal(after.requests, plan.requests)
    assert "from speed limits" in after.stopped
    assert not plan.stopped
    assert after.learning.floor[0] == pytest.approx(plan.rms, rel=0.05)


def test_a_late_sensor_is_not_learnt_as_motion() -> None:
    """Where it is known, or long and the whole of the difference; a short one is mentioned."""
    desired = random_path(5, 88, span=1.0, fastest=0.03)
    plan = planner.invert_optimal(ERS210A, desired)
    for late, given in ((6, None), (2, 2 * ERS210A.period)):
        joint = MadeJoint(ERS210A, noise=math.radians(0.05), late=late)
        after = planner.refine(plan, joint.play(plan.requests, 3)[1], sensor_delay=given)
        assert rms(joint.angles(after.requests) - desired) < math.radians(0.05)
        removed = after.learning.delays[0].removed
        assert removed == pytest.approx(late * ERS210A.period, rel=0.05)
        said = f"angles are taken to be {1e3 * removed:.3g} ms late, by their sensor or log"
        assert any(said in remark for remark in after.learning.remarks)
    after = planner.refine(plan, MadeJoint(ERS210A, late=2).play(plan.requests)[1])
    assert after.learning.delays[0].seconds == pytest.approx(2 * ERS210A.period, rel=0.05)
    assert any("late by it: sensor_delay=0.016" in remark for remark in after.learning.remarks)
    noisy = MadeJoint(ERS210A, noise=math.radians(1.5), late=2).play(plan.requests, 40)[1]
    after = planner.refine(plan, noisy)
    assert after.learning.delays[0].share > 0.9
    assert after.learning.remarks == ()  # as a cycle's noise is half of what the delay makes


def test_a_sensors_delay_stays_what_it_was_and_the_same_requests_are_one_trial() -> None:
    desired = random_path(5, 88, span=1.0, fastest=0.03)
    plan = planner.invert_optimal(ERS210A, desired)
    joint = MadeJoint(replace(ERS210A, theta_0=1.1 * ERS210A.theta_0), late=2)
    after = planner.refine(plan, joint.play(plan.requests)[1], sensor_delay=2 * ERS210A.period)
    after = planner.refine(after, joint.play(after.requests)[1])
    assert after.learning.delays[0].removed == 2 * ERS210A.period
    plan = planner.invert_optimal(ERS210A, desired)
    noisy = MadeJoint(ERS210A, noise=math.radians(0.5)).play(plan.requests, 3)[1]
    once = planner.refine(plan, noisy[:2])
    twice = planner.refine(replace(plan, learning=(once.learning,)), noisy[2])
    assert [trial.cycles for trial in twice.learning.trials] == [3]
    assert twice.learning.trials[0].error == pytest.approx(rms(noisy.mean(axis=0) - desired))


def test_cycles_that_disagree_with_earlier_ones_of_the_same_requests_begin_learning_anew() -> None:
    """A joint that becomes slower is learnt as from the first trial on, and has that noise."""
    desired = random_path(5, 88, span=1.0, fastest=0.03)
    noise = math.radians(0.25)
    plan = before = planner.invert_optimal(ERS210A, desired)
    for _ in range(2):
        before = planner.refine(before, MadeJoint(ERS210A, noise=noise).play(plan.requests, 4)[1])
        before = replace(before, requests=plan.requests)
    assert before.learning.remarks == (
        "4 new and 4 earlier cycles of the same requests are averaged",
    )
    weaker = MadeJoint(replace(ERS210A, theta_0=1.5 * ERS210A.theta_0), noise=noise, seed=1)
    cycles = weaker.play(plan.requests, 4)[1]
    changed = planner.refine(before, cycles)
    afresh = planner.refine(plan, cycles)
    (remark,) = set(changed.learning.remarks) - set(afresh.learning.remarks)
    errors = [f"{math.degrees(each.learning.errors[0]):.3f} deg" for each in (changed, before)]
    assert (
        f"the same requests gave {errors[0]} rms where 8 earlier cycles had {errors[1]}" in remark
    )
    assert changed.learning.noise[0] == pytest.approx(noise, rel=0.25)
    np.testing.assert_array_equal(changed.requests, afresh.requests)
    for name in ("errors", "noise", "gain", "best", "floor", "next_error", "stopped"):
        np.testing.assert_array_equal(*(getattr(each.learning, name) for each in (changed, afresh)))
    last = planner.refine(changed, weaker.play(changed.requests, 4)[1])
    assert last.learning.errors[1] < 0.5 * last.learning.errors[0]


def test_a_changed_joint_is_learnt_anew_whatever_was_identified_before(two_trials) -> None:
    _, _, second = two_trials
    sent = second.learning.trials[1].requests[:, 0]
    slower = MadeJoint(replace(ERS210A, v_max=0.5 * ERS210A.v_max), noise=math.radians(0.05))
    changed = planner.refine(replace(second, requests=sent), slower.play(sent, 3)[1])
    assert len(changed.learning.trials) == 1
    assert changed.learning.reidentified == (0,)
    assert changed.model == second.model


@pytest.mark.parametrize("seed", [2, 4])
def test_the_error_that_comes_next_is_near_the_one_predicted(seed: int) -> None:
    """From the third trial on: the second one shows what the model misses of changed requests."""
    joint = random_joint(seed)
    desired = random_path(seed, 88, span=1.2, fastest=0.03)
    plan = planner.invert_optimal(ERS210A, desired)
    for trial in range(4):
        sensed = joint.play(plan.requests)[1]
        if trial >= 2:
            came = rms(sensed.mean(axis=0) - desired)
            assert 0.7 * came < plan.learning.next_error < 1.4 * came
        plan = planner.refine(plan, sensed, reidentify=False)


def test_a_fifth_of_what_the_next_requests_change_is_in_the_error_predicted(attained) -> None:
    """An offset, which all requests take back, on a path that the model follows."""
    off = math.radians(2.0)
    after = planner.refine(attained, attained.predicted + off, reidentify=False, sensor_delay=0.0)
    np.testing.assert_allclose(after.requests, attained.requests - off, atol=0.02 * off)
    assert after.learning.next_error == pytest.approx(off / 5.0, rel=0.02)


@pytest.mark.parametrize(("unforeseen", "shorter"), [(0.2, False), (1.5, True), (3.0, True)])
def test_requests_change_as_far_as_what_joints_do_not_follow_pays(
    attained, monkeypatch: pytest.MonkeyPatch, unforeseen, shorter
) -> None:
    """Along the straight line to the requests of (20), so that what limits these holds."""
    measured = attained.predicted + 0.02 * np.sin(2.0 * np.pi * np.arange(88) / 22.0)
    error = rms(measured - attained.desired)

    def next_of(share: float) -> planner.Inversion:
        monkeypatch.setattr(refining, "UNFORESEEN", share)
        return planner.refine(attained, measured, reidentify=False)

    whole, after = next_of(0.0), next_of(unforeseen)
    answers = [planner.simulate(ERS210A, each.requests) for each in (attained, whole)]
    saving = error - rms(answers[1] + measured - answers[0] - attained.desired)
    missed = unforeseen * rms(answers[1] - answers[0])
    shares = np.linspace(0.0, 1.0, 10_001)
    errors = np.hypot(error - shares * saving, shares * missed)
    best = shares[np.argmin(errors)] if errors[-1] > 1.05 * np.min(errors) else 1.0
    assert (best < 1.0) == shorter
    expected = attained.requests + best * (whole.requests - attained.requests)
    np.testing.assert_allclose(after.requests, expected, atol=1e-5)


@pytest.mark.parametrize(
    ("steps", "deviations", "ends"), [(0.3, 1.6, True), (0.3, 2.4, False), (1.1, 1.6, False)]
)
def test_an_error_within_the_noise_and_an_encoders_step_ends_learning(
    attained, steps, deviations, ends
) -> None:
    """An offset, in steps of the encoder and in standard deviations of the mean of four cycles."""
    off = steps * ENCODER_STEP
    noise = np.random.default_rng(5).standard_normal((4, 88))
    noise -= noise.mean(axis=0)
    noise *= 2.0 * off / deviations / math.sqrt(np.mean(noise**2) * 4.0 / 3.0)
    after = planner.refine(attained, attained.predicted + off + noise, reidentify=False)
    assert ("noise hides what is left" in after.stopped) == ends
    if ends:  # of the mean of as many cycles as were measured last
        assert after.learning.next_error == pytest.approx(after.learning.errors[0])
        once = planner.refine(after, attained.predicted + off + noise[0], reidentify=False).learning
        expected = math.hypot(once.errors[0], math.sqrt(0.8) * once.noise[0])
        assert once.next_error == pytest.approx(expected)


@pytest.fixture(scope="module")
def two_trials() -> tuple[MadeJoint, planner.Inversion, planner.Inversion]:
    """A slower joint, and the plans after a trial of three cycles and after a second one."""
    true = replace(ERS210A, v_max=0.75 * ERS210A.v_max, theta_0=1.2 * ERS210A.theta_0)
    joint = MadeJoint(true, noise=math.radians(0.05))
    plan = planner.invert_optimal(ERS210A, random_path(3, 88, span=1.2, fastest=0.05))
    first = planner.refine(plan, joint.play(plan.requests, 3)[1])
    return joint, first, planner.refine(first, joint.play(first.requests, 3)[1])


def test_a_second_trial_identifies_the_model_anew_where_that_predicts_it_better(two_trials) -> None:
    joint, first, second = two_trials
    assert second.model.v_max == pytest.approx(joint.model.v_max, rel=0.03)
    said = "the model was identified anew from the measured cycles"
    assert any(remark.startswith(said) for remark in second.learning.remarks)
    assert second.learning.reidentified == (1,)
    measured = joint.play(first.requests, 3)[1]
    assert planner.refine(first, measured, reidentify=False).model == ERS210A
    for anew in (True, False):
        joints = planner.refine(first.plan, measured[:, :, np.newaxis], reidentify=anew)
        assert (joints.models[0] == ERS210A) != anew


def test_cycles_of_the_same_requests_identify_no_model(two_trials) -> None:
    """Any model that is fitted to a motion predicts that motion."""
    joint, first, _ = two_trials
    again = replace(first, requests=first.learning.trials[0].requests[:, 0])
    measured = joint.play(first.requests, 3)[1]
    second = planner.refine(first, measured, reidentify=False)  # as would be, but for this
    back = replace(second, requests=again.requests)
    for plan in (
        first,
        *(planner.refine(each, joint.play(each.requests, 5)[1]) for each in (again, back)),
    ):
        assert plan.model == ERS210A
        assert plan.learning.reidentified == (0,)


def test_a_motion_from_rest_is_learnt_and_starts_where_it_did() -> None:
    true = replace(ERS210A, theta_0=1.2 * ERS210A.theta_0, lag=1.2 * ERS210A.lag)
    desired = np.radians(30.0) * (1.0 - np.cos(np.linspace(0.0, np.pi, 100)))
    errors, plan = learnt(MadeJoint(true, cyclic=False), desired, 5)
    assert errors[-1] < 0.1 * errors[0]
    assert plan.requests[0] == planner.invert_optimal(ERS210A, desired, cyclic=False).requests[0]


def test_the_next_requests_keep_the_limits_and_the_largest_step_of_the_plan() -> None:
    desired = random_path(4, 88, span=1.2, fastest=0.05)
    plan = planner.invert_optimal(ERS210A, desired, limits=(-0.8, 0.8), max_step=0.08)
    true = replace(ERS210A, theta_0=1.2 * ERS210A.theta_0, lag=1.2 * ERS210A.lag)
    for _ in range(2):
        angles = planner.simulate(true, plan.requests)
        plan = planner.refine(plan, angles, reidentify=False)
        assert plan.largest_step <= 0.08 + 1e-9
        assert np.max(np.abs(plan.requests)) <= 0.8
    assert plan.learning.errors[1] < 0.5 * plan.learning.errors[0]


def test_joints_of_a_plan_learn_each_by_themselves_and_keep_their_names() -> None:
    desired = np.column_stack([0.3 * np.sin(PHASE), 0.2 * np.cos(PHASE)])
    plan = planner.plan(ERS210A, desired, names=["hip", "knee"], limits=(-0.6, 0.6))
    true = replace(ERS210A, theta_0=1.2 * ERS210A.theta_0)
    angles = np.column_stack([planner.simulate(true, column) for column in plan.requests.T])
    after = planner.refine(plan, angles, reidentify=False)
    angles = np.column_stack([planner.simulate(true, column) for column in after.requests.T])
    after = planner.refine(after, np.stack([angles, angles]), reidentify=False)
    assert after.names == plan.names
    assert [len(each.learning.trials) for each in after.inversions] == [2, 2]
    assert set(after.stopped) <= {"hip", "knee"}
    with pytest.raises(planner.InvalidTrajectory, match=r"\(88, 2\) or \(cycles, 88, 2\)"):
        planner.refine(plan, angles[:, 0])
    with pytest.raises(planner.InvalidTrajectory, match=r"the joint does not move: .*\nknee$"):
        planner.refine(plan, angles * [1.0, 0.0])


def test_a_foot_is_learnt_with_all_joints_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("planner.planning.plan.Plan.foot_bound", None)  # not while learning goes on
    monkeypatch.setattr(refining, "reidentified", None)  # not where it shall not be
    walk = planner.reference_walk()
    true = replace(ERS210A, v_max=0.95 * ERS210A.v_max, lag=1.2 * ERS210A.lag, v_offset=0.1)
    plan = planner.invert_foot(ERS210A, walk.leg, walk.desired_foot)
    errors = []
    for _ in range(3):
        angles = np.column_stack([planner.simulate(true, column) for column in plan.requests.T])
        foot = walk.leg.foot_positions(angles)
        errors.append(rms(np.linalg.norm(foot - walk.desired_foot, axis=1)))
        plan = planner.refine(plan, angles, reidentify=False)
    best = planner.invert_foot(true, walk.leg, walk.desired_foot)
    assert errors[0] > 1.1 * best.rms
    assert errors[-1] < 1.05 * best.rms
    assert plan.learning.errors.min() == pytest.approx(min(errors))


@pytest.fixture(scope="module")
def attained() -> planner.Inversion:
    """A plan that the joint follows, with a range of 0.6 rad."""
    return planner.invert_optimal(ERS210A, 0.3 * np.sin(PHASE), smoothness=0.0)


@pytest.mark.parametrize(
    ("spread", "off", "left_out"),
    [
        (0.0, 0.009, False),  # less than a hundredth of the range
        (0.0, 0.011, True),
        (0.02, 0.078, False),  # less than four deviations of the others
        (0.02, 0.082, True),
    ],
)
def test_a_first_cycle_is_left_out_by_a_hundredth_of_the_range_and_four_deviations(
    spread, off, left_out, attained
) -> None:
    """The others differ to either side of their mean, in shares of its range of 0.6 rad."""
    apart = 0.6 * np.array([off, spread, -spread])[:, np.newaxis]
    after = planner.refine(attained, attained.predicted + apart, reidentify=False, sensor_delay=0.0)
    assert [trial.cycles for trial in after.learning.trials] == [2 if left_out else 3]
    few = attained.predicted + apart[:2]
    few = planner.refine(attained, few, reidentify=False, sensor_delay=0.0)
    assert [trial.cycles for trial in few.learning.trials] == [2]


@pytest.mark.parametrize(("share", "ended"), [(0.06, True), (0.1, False)])
def test_learning_ends_where_less_than_three_thousandths_of_the_error_can_be_saved(
    share, ended
) -> None:
    """An offset of a share of an error that remains adds half the square of that share to it."""
    plan = planner.invert_optimal(ERS210A, 1.4 * np.sin(PHASE), smoothness=0.0)
    assert abs(np.mean(plan.errors)) < 0.01 * plan.rms
    measured = plan.predicted + share * plan.rms
    after = planner.refine(plan, measured, reidentify=False, sensor_delay=0.0)
    assert bool(after.stopped) is ended
    if ended:
        assert "less than 0.3 %" in after.stopped
        np.testing.assert_array_equal(after.requests, plan.requests)
        assert after.learning.next_error == after.learning.errors[0]
    else:
        assert after.learning.next_error < 0.997 * after.learning.errors[0]


def after_trials(plan: planner.Inversion, *errors: float) -> planner.Inversion:
    """The plan after trials that were off by these everywhere [rad]."""
    for error in errors:
        measured = plan.desired + error
        plan = planner.refine(plan, measured, reidentify=False, sensor_delay=0.0)
    return plan


@pytest.mark.parametrize(
    ("errors", "best", "gain"),
    [
        ((0.02, 0.0201), 1, 1.0),  # within a hundredth it is no worse
        ((0.02, 0.0203), 0, 1.0 / 3.0),
        ((0.02, 0.03, 0.01), 2, 0.5),
        ((0.02, 0.03, 0.031), 0, 1.0 / 9.0),
        ((0.02, 0.03, 0.01, 0.005, 0.001), 4, 1.0),
        ((0.02, 0.03, 0.0201, 0.0205), 2, 1.0 / 6.0),
        ((0.02, 0.0201, 0.02025), 1, 1.0 / 3.0),  # worse than the least error of all
    ],
)
def test_the_gain_falls_to_a_third_after_a_worse_trial_and_grows_by_half_after_another(
    errors, best, gain, attained
) -> None:
    learning = after_trials(attained, *errors).learning
    assert learning.best == best
    assert learning.gain == pytest.approx(gain)
    np.testing.assert_allclose(learning.errors, errors, rtol=1e-9)


def test_what_is_learnt_with_a_gain_is_that_share_of_what_is_new(attained) -> None:
    """Constant errors repeat, so that all of them is learnt, from the best trial on."""
    full = after_trials(attained, 0.02)
    np.testing.assert_allclose(full.disturbance, 0.02, rtol=0.02)
    less = after_trials(attained, 0.02, 0.03)
    np.testing.assert_allclose(less.disturbance, 0.02 / 3.0, rtol=0.05)


def test_measured_angles_before_their_requests_are_refused_as_exchanged():
    desired = 0.4 * np.sin(2.0 * np.pi * np.arange(125) / 125)
    model = planner.JointModel.ers210a()
    plan = planner.invert_optimal(model, desired)
    angles = planner.simulate(model, plan.requests)
    with pytest.raises(planner.InvalidTrajectory, match="are requests and measured angles exch"):
        planner.refine(replace(plan, requests=angles), plan.requests)


@pytest.mark.parametrize(
    ("missed", "noise", "share"),
    [
        (0.5, 0.0, 0.5),
        (0.1, 0.0, 0.2),
        (0.5, 0.2, math.sqrt(0.5**2 - 1.25 * 0.2**2)),
        (1.5, 0.9, 0.2),  # the change is within the noise
    ],
)
def test_what_the_last_change_did_not_do_is_expected_of_the_next_too(missed, noise, share):
    """In shares of the change of the angles by the model, without what noise explains of it."""
    plan = planner.plan(ERS210A, 0.3 * np.sin(PHASE)[:, np.newaxis])
    requests = [plan.requests, plan.requests + 0.02 * np.sin(3.0 * PHASE)[:, np.newaxis]]
    first, second = (plan.task.response(each) for each in requests)
    third = second - missed * (second - first)
    trials = [
        Trial(requests=sent, measured=np.stack([angles] * cycles), error=0.1)
        for sent, angles, cycles in zip(requests, (first, third), (4, 1), strict=True)
    ]
    deviation = noise * np.array([rms(second - first)])
    assert refining._unforeseen(plan, trials, deviation) == pytest.approx(share, rel=1e-6)
    assert refining._unforeseen(plan, trials[1:], deviation) == 0.2
