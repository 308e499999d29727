"""From a servo's log to requests that it follows.

    python examples/own_servo.py                 # a simulated servo in place of yours
    python examples/own_servo.py my_log.csv      # columns t_s, requested_deg, actual_deg

Writes requests.csv, to be played, and own_servo.svg, desired against direct and planned angles.
"""

from __future__ import annotations

import sys

import matplotlib.pyplot as plt
import numpy as np

import planner


def recorded() -> planner.Log:
    """A log as a servo might give it: step tests of three sizes, with noise, in steps of 0.3°."""
    servo = planner.JointModel(v_max=4.8, theta_0=0.16, lag=0.021, acceleration_time=0.035)
    steps = [planner.step_test(np.radians(size), samples=180) for size in (15, 60, 110)]
    requests = np.concatenate([np.tile(step, 3) for step in steps])
    angles = planner.simulate(servo, requests, cyclic=False)
    noise = np.random.default_rng(0).normal(0.0, np.radians(0.2), len(angles))
    sensed = np.radians(0.3) * np.round((angles + noise) / np.radians(0.3))
    return planner.Log(
        times=servo.period * np.arange(len(requests)), requests=requests, angles=sensed
    )


def desired_motion(period: float) -> np.ndarray:
    """One second of a sweep back and forth, quicker at times than the servo can [rad]."""
    phase = 2.0 * np.pi * np.arange(round(1.0 / period)) * period
    return np.radians(40.0 * np.sin(phase) + 10.0 * np.sin(3.0 * phase))


def draw(desired: np.ndarray, direct: np.ndarray, plan: planner.Inversion) -> None:
    """Draw desired, direct and planned angles, and the requests."""
    times = plan.model.period * np.arange(len(desired))
    figure, axes = plt.subplots(figsize=(7.5, 3.6), layout="constrained")
    axes.plot(times, np.degrees(plan.requests), color="#d18b00", label="requested, as planned")
    axes.plot(
        times, np.degrees(direct), color="#c8501a", label="direct: the desired angles requested"
    )
    axes.plot(times, np.degrees(plan.predicted), color="#0067a8", lw=2.4, label="planned")
    axes.plot(times, np.degrees(desired), "--", color="#15181c", label="desired")
    axes.set(xlabel="time [s]", ylabel="angle [deg]")
    axes.spines[["top", "right"]].set_visible(False)
    figure.legend(loc="outside upper center", ncols=2, frameon=False)
    figure.savefig("own_servo.svg")
    plt.close(figure)


def main() -> None:
    """Identify, plan, compare, write."""
    logs = planner.read_logs(sys.argv[1]) if len(sys.argv) > 1 else [recorded()]
    result = planner.identify(logs)
    for warning in result.warnings:
        print("warning:", warning)
    for name, (lower, upper) in result.intervals.items():
        print(f"{name} = {getattr(result.model, name):.4f}, from {lower:.4f} to {upper:.4f}")
    if not result.accepted:
        raise SystemExit("the model does not describe this servo: do not plan with it")

    desired = desired_motion(result.model.period)
    limits = (np.radians(-60.0), np.radians(60.0))
    plan = planner.invert_optimal(result.model, desired, limits=limits)
    direct = planner.simulate(result.model, desired)
    error = np.degrees(np.sqrt(np.mean((direct - desired) ** 2)))
    print(f"requesting the desired angles: {error:.2f} deg rms")
    print(f"planned: {np.degrees(plan.rms):.2f}, at most {100 * plan.gap:.1f} % above the optimum")

    times = result.model.period * np.arange(len(desired))
    table = np.column_stack([times, np.degrees(plan.requests)])
    np.savetxt("requests.csv", table, delimiter=",", header="t_s,servo_deg", comments="")
    draw(desired, direct, plan)


if __name__ == "__main__":
    main()
