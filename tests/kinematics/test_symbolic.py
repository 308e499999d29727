"""Any leg, in numbers and in CasADi: against Pinocchio, differences and itself."""

import numpy as np
import pinocchio
from hypothesis import given
from hypothesis import strategies as st

from kinematics import Leg, foot_function
from tests.kinematics.made_up_robots import Joint, urdf_text

ROUNDING = 1e-12  # two routes through the same kinematics agree to this [m, m/rad]
coordinates = st.tuples(*[st.floats(-0.5, 0.5)] * 3)

axes = st.sampled_from([(1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0)]) | st.tuples(
    *[st.floats(-1.0, 1.0)] * 3
).filter(lambda axis: np.linalg.norm(axis) > 0.1)

joints = st.builds(
    Joint,
    coordinates,
    axes,
    rpy=st.tuples(*[st.floats(-3.0, 3.0)] * 3),
    kind=st.sampled_from(["revolute", "continuous"]),
)

chains = st.lists(joints, min_size=1, max_size=6)


def pinocchios(model, names, pose):
    """Position of the tip and of named joints, and Jacobian by them, by Pinocchio alone."""
    data, tip = model.createData(), model.getFrameId("tip")
    configuration = pinocchio.neutral(model)
    ids = [model.getJointId(name) for name in names]
    for joint, angle in ((model.getJointId(name), angle) for name, angle in pose.items()):
        both = [angle] if model.nqs[joint] == 1 else [np.cos(angle), np.sin(angle)]
        configuration[model.idx_qs[joint] :][: len(both)] = both
    pinocchio.computeJointJacobians(model, data, configuration)
    pinocchio.updateFramePlacements(model, data)
    jacobian = pinocchio.getFrameJacobian(
        model, data, tip, pinocchio.ReferenceFrame.LOCAL_WORLD_ALIGNED
    )[:3, [model.idx_vs[joint] for joint in ids]]
    origins = [data.oMi[joint].translation for joint in ids]
    return data.oMf[tip].translation, origins, jacobian


@given(chain=chains, tip=coordinates, seed=st.integers(0, 2**32 - 1))
def test_any_leg_agrees_with_pinocchio_in_numbers_and_in_symbols(
    chain, tip, seed, tmp_path_factory
):
    """Some of its joints may be held."""
    path = tmp_path_factory.mktemp("robot") / "robot.urdf"
    path.write_text(urdf_text(chain, tip), encoding="utf-8")
    random = np.random.default_rng(seed)
    names = [f"joint_{number}" for number in range(1, len(chain) + 1)]
    free = sorted(random.choice(names, random.integers(1, len(chain) + 1), replace=False).tolist())
    held = {name: random.uniform(-2.0, 2.0) for name in names if name not in free}
    leg = Leg.from_urdf(path, base="link_0", foot="tip", locked=held)
    assert leg.joint_names == tuple(free)
    model, function = pinocchio.buildModelFromXML(urdf_text(chain, tip)), foot_function(leg)
    angles = random.uniform(-3.0, 3.0, (4, len(free)))
    numeric = leg.foot_positions(angles), leg.joint_positions(angles), leg.jacobians(angles)
    for pose, foot, points, derivatives in zip(angles, *numeric, strict=True):
        whole = dict(zip(free, pose, strict=True)) | held
        position, origins, jacobian = pinocchios(model, free, whole)
        symbolic_position, symbolic_jacobian = function(pose)
        for found in (foot, symbolic_position.full()[:, 0]):
            np.testing.assert_allclose(found, position, atol=ROUNDING)
        for found in (derivatives, symbolic_jacobian.full()):
            np.testing.assert_allclose(found, jacobian, atol=ROUNDING)
        np.testing.assert_allclose(points[:-1], origins, atol=ROUNDING)
        np.testing.assert_array_equal(points[-1], foot)
