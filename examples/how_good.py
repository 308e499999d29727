"""How good a plan is, and how good any could be: lines, optimised requests and bounds.

    python examples/how_good.py

Writes how_good.svg, the error for every number of lines above the lower bound.
"""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np

import planner


def main() -> None:
    """Plan the rotator of the reference walk with more and more lines, and bound it."""
    joint, desired = planner.JointModel.ers210a(), planner.reference_walk().desired[:, 0]
    optimal = planner.invert_optimal(joint, desired)
    bounds = {
        level: planner.certify(joint, desired, level=level) for level in ("slope", "envelope")
    }
    print(f"optimised: {np.degrees(optimal.rms):.3f} deg rms")
    for level, certificate in bounds.items():
        share = 100.0 * (optimal.rms / certificate.bound - 1.0)
        print(f"lower bound ({level}): {np.degrees(certificate.bound):.3f}, {share:.2f} % away")

    counts = range(2, 11)
    errors = {
        "closed form, as in the paper": [
            planner.invert_closed_form(joint, desired, segments=lines, refine=False).rms
            for lines in counts
        ],
        "closed form, knots refined": [
            planner.invert_closed_form(joint, desired, segments=lines).rms for lines in counts
        ],
    }
    figure, axes = plt.subplots(figsize=(7.5, 3.4), layout="constrained")
    for (name, rms), colour in zip(errors.items(), ("#8a4b9f", "#0067a8"), strict=True):
        print(f"{name}: {np.degrees(min(rms)):.2f} deg rms with {counts[np.argmin(rms)]} lines")
        axes.plot(counts, np.degrees(rms), "o-", color=colour, label=name)
    axes.axhline(np.degrees(optimal.rms), color="#00805f", label="optimised")
    axes.axhline(np.degrees(bounds["envelope"].bound), color="#15181c", ls="--", label="bound")
    axes.set(xlabel="lines of the approximation", ylabel="rms error [deg]")
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False)
    figure.savefig("how_good.svg")
    plt.close(figure)


if __name__ == "__main__":
    main()
