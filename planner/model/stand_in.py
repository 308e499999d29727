"""A joint of which no more than the top speed is known."""

from __future__ import annotations

from dataclasses import replace

from planner.model.joint import JointModel


def stand_in(v_max: float) -> JointModel:
    """The paper's servo, made as fast: a joint to begin with until its own has been identified.

    Lag, acceleration time and tick are those of Table 1, and so is the time v_max takes to cover
    theta_0. A robot's description tells none of them, and the effort that it tells says little
    about a servo's own controller.

    Args:
        v_max: Top speed [rad/s].

    Returns:
        The model.

    Raises:
        InvalidModel: The speed is not a number above 0.
    """
    paper = JointModel.ers210a()
    return replace(paper, v_max=v_max, theta_0=v_max * (paper.theta_0 / paper.v_max))
