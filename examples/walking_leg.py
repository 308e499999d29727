"""A walking leg: the desired path of its foot, requested directly, joint by joint, and as a whole.

    python examples/walking_leg.py

Writes walking_leg.svg, the foot's paths seen from the side.
"""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np

import planner


def main() -> None:
    """Plan the reference walk three ways, and say where the foot is under each."""
    joint, walk = planner.JointModel.ers210a(), planner.reference_walk()
    columns = walk.desired.T  # of the joints that the walk's inverse kinematics asks for [rad]
    lower, upper = walk.leg.limits
    each = [
        planner.invert_optimal(joint, angles, limits=(low, high))
        for angles, low, high in zip(columns, lower, upper, strict=True)
    ]
    whole = planner.invert_foot(joint, walk.leg, walk.desired_foot)
    direct = np.column_stack([planner.simulate(joint, angles) for angles in columns])
    paths = {
        "desired": walk.desired_foot,
        "direct": walk.leg.foot_positions(direct),
        "joint by joint": walk.leg.foot_positions(np.column_stack([p.predicted for p in each])),
        "all at once": whole.foot,
    }
    figure, axes = plt.subplots(figsize=(7.5, 3.6), layout="constrained")
    colours = {"direct": "#c8501a", "joint by joint": "#00805f", "all at once": "#b3126b"}
    for name, path in paths.items():
        far = 100.0 * np.linalg.norm(path - walk.desired_foot, axis=1)
        if name != "desired":
            print(f"{name}: {np.sqrt(np.mean(far**2)):.2f} cm rms, {far.max():.2f} at most")
        around = 100.0 * np.vstack([path, path[:1]])  # [cm]
        style = {"color": colours[name]} if name in colours else {"color": "#15181c", "ls": "--"}
        axes.plot(around[:, 0], around[:, 2], label=name, **style)
    axes.set(xlabel="forward [cm]", ylabel="up [cm]", aspect="equal")
    axes.spines[["top", "right"]].set_visible(False)
    figure.legend(loc="outside right center", frameon=False)
    figure.savefig("walking_leg.svg")
    plt.close(figure)


if __name__ == "__main__":
    main()
