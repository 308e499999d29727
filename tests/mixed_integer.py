"""The exact level's oracle: condition 4 as a mixed-integer programme, stated in CVXPY for SCIP.

It shares nothing with the package's own search but the joint's window. In units of v_max a tick,
with u(r, t) in [-1, 1] for the saturated speed that request r contributes at tick t, and
k = v_max / theta_0 (``docs/math.md``, condition 4),

    x(t) - x(t-1) = w(t) = sum_r W(r, t) u(r, t),
    -k max(0, w(t)) <= u(r, t+1) - u(r, t) <= k max(0, -w(t)).

One binary a tick says which of max(0, w) and max(0, -w) is zero. The set is larger than that of the
search, which adds condition 5, so that the search proves at least as much.
"""

from collections import defaultdict

import cvxpy
import numpy as np

SOLVER_TOLERANCE = 1e-4  # relative gap between SCIP's bound and its best answer at which it stops
MARGIN = 1e-5
"""Relative amount taken off SCIP's bound, which holds only within its tolerances (1e-6)."""


def mixed_integer_bound(model, desired):
    """A lower bound on the rms error of any plan of a cycle, and the programme's optimum [rad]."""
    unit, gain = model.v_max_per_tick, model.v_max_per_tick / model.theta_0
    ticks = len(desired) * model.hold
    weight = defaultdict(float)
    for tick in range(ticks):
        for age, share in enumerate(model.window.weights, start=model.window.first):
            weight[tick, (tick - age) // model.hold % len(desired)] += share
    place = {pair: index for index, pair in enumerate(weight)}
    window = np.zeros((ticks, len(place)))
    for (tick, request), share in weight.items():
        window[tick, place[tick, request]] = share
    angles = cvxpy.Variable(ticks)
    contributions = cvxpy.Variable(len(place), bounds=[-1.0, 1.0])
    forward, backward = cvxpy.Variable(ticks, nonneg=True), cvxpy.Variable(ticks, nonneg=True)
    is_forward = cvxpy.Variable(ticks, boolean=True)
    conditions = [
        angles - angles[np.arange(ticks) - 1] == forward - backward,
        forward - backward == window @ contributions,
        forward <= is_forward,
        backward <= 1.0 - is_forward,
    ]
    for (tick, request), index in place.items():
        later = place.get(((tick + 1) % ticks, request))
        if later is not None:
            change = contributions[later] - contributions[index]
            conditions += [change <= gain * backward[tick], change >= -gain * forward[tick]]
    middle = np.mean(desired)
    errors = angles[:: model.hold] - (desired - middle) / unit
    problem = cvxpy.Problem(cvxpy.Minimize(cvxpy.sum_squares(errors)), conditions)
    options = {"limits/gap": SOLVER_TOLERANCE, "parallel/maxnthreads": 1}
    problem.solve(solver=cvxpy.SCIP, scip_params=options)
    proved = problem.solver_stats.extra_stats["model"].getDualbound()
    bound, optimum = (unit * np.sqrt(value / len(desired)) for value in (proved, problem.value))
    return bound * (1.0 - MARGIN), optimum
