"""Whatever a caller gives to a public function: an answer that holds, or one clear error."""

import inspect
import re
from collections import defaultdict
from dataclasses import fields, is_dataclass

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import kinematics
import planner
from kinematics import KinematicsError
from planner import PlannerError
from tests.robustness.entrances import ANSWERS, ENTRANCES, MISSING, function, places
from tests.snapshots import NUMBER

NUMBERS = [
    *(0, 1, -1, 2, 3, 10**400, -(10**400), 2**63, 0.0, -0.0, 0.5, 1e-320, 1e-9, 1e6, 1e18),
    *(1e308, -1e308, float("nan"), float("inf"), -float("inf"), True, False),
    *(np.float32(0.3), np.float64("nan"), np.int8(-3), np.bool_(True), 1j, 1.0 + 0.0j),
]
"""Numbers, and what looks like them."""

OTHERS = [
    *(None, "", "x", "nan", "1.0", "\0", "٣", "rms\n", b"1", b"", object(), int, len, ...),
    *((), [], {}, set(), {1: 2}, {"times": None}, [None], [[]], [[1.0], [2.0, 3.0]], range(3)),
    *((None, None), ("a", "b"), (1.0, 0.0), (0.0, 1.0), (1, 2, 3), iter([1.0]), slice(3)),
    *((1.0, -1.0, 1.0), (-2.0, (2.0, float("nan"), 2.0)), (-2.0, (2.0, 2.0, -3.0))),
]
"""What is no number."""

ARRAYS = [
    *(np.zeros(0), np.zeros((0, 3)), np.zeros((3, 0)), np.zeros(()), np.zeros(1), np.zeros(2)),
    *(np.ones(20), np.ones((20, 3)), np.ones((2, 2, 2)), np.full(20, np.nan), np.full(20, 1e300)),
    *(np.full((20, 3), np.inf), np.full((20, 3), 1e300), np.full((20, 3), 1e-300)),
    *(np.arange(20), np.arange(20) % 2 == 0, np.full(20, "a"), np.full(20, None)),
    *(np.array([1.0, None, "x"], dtype=object), np.full(20, 1j), np.full(20, 10**400)),
    *(np.zeros(20, dtype="datetime64[s]"), np.zeros(20, dtype=[("a", "f8")]), np.zeros(20, "S3")),
    *(np.ma.masked_array(np.ones(20), mask=np.arange(20) > 9)),
    *([0.1 * k for k in range(20)], [str(k) for k in range(20)], [10**400] * 20, [True] * 20),
    *(np.broadcast_to(0.1, 20), np.arange(60.0)[::-3], np.arange(20.0).astype(">f4")),
    *([[0.1] * 20] * 3, [float("nan")] * 20, "0.1" * 20, np.full(20, np.float16(0.3))),
]
"""Arrays, lists, and what NumPy makes arrays of."""

ANYTHING = st.one_of(
    st.sampled_from(NUMBERS),
    st.sampled_from(OTHERS),
    st.sampled_from(ARRAYS),
    st.floats(width=32),
    st.integers(-5, 200),
    st.text(max_size=3),
    st.lists(st.floats(allow_nan=True), max_size=5),
)
"""Any of them."""

HOSTILE = {"number": NUMBERS, "other": OTHERS, "array": ARRAYS}
UNBOUNDED = {"lower", "upper", "max_step", "intervals", "gain_interval", "gap"}
"""Fields in which infinity says that there is no limit."""
CALLED = {"progress", "on_stop", "report", "send", "measure"}  # arguments that are functions
OF_ONE_ARGUMENT = {
    *("PiecewiseLinear.slope_at", "CurveStack.of", "read_models"),
    *("Leg.foot_positions", "Leg.joint_positions", "Leg.jacobians", "Leg.jumps"),
    *("foot_function", "urdf_path"),
}
"""Counted here, as making the arguments of all others would compile functions at import."""
OPEN = {"speeds", "predicted", "held_out_predicted"}
"""Fields in which NaN says that nothing is known."""


def _call(name, arguments, refused=None):
    """The answer, or None for an error of ours; any other error or warning fails the test."""
    try:
        return function(name)(**arguments)
    except (PlannerError, KinematicsError) as error:
        message = str(error)
        assert message.isprintable(), message
        assert len(message) < 1500, message
        if refused is not None:
            refused.append(error)
        return None


def _check_arrays(answer, place="answer"):
    """Every array in an answer is read-only and finite."""
    if isinstance(answer, np.ndarray):
        assert not answer.flags.writeable, place
        name = place.rpartition(".")[2]
        if answer.dtype.kind == "f" and name not in UNBOUNDED:
            assert not np.isinf(answer).any(), place
            assert name in OPEN or not np.isnan(answer).any(), place
    elif isinstance(answer, tuple):
        for part in answer:
            _check_arrays(part, place)
    elif is_dataclass(answer) and not isinstance(answer, type):
        for field in fields(answer):
            _check_arrays(getattr(answer, field.name), f"{place}.{field.name}")


def test_every_public_function_is_among_the_entrances():
    covered = {name.partition(".")[0] for name in ENTRANCES} | ANSWERS
    public = {
        name
        for module in (planner, kinematics)
        for name in module.__all__
        if callable(getattr(module, name)) and name != "reference_walk"  # takes nothing
    }
    errors = {
        name
        for module in (planner, kinematics)
        for name in module.__all__
        if inspect.isclass(getattr(module, name)) and issubclass(getattr(module, name), Exception)
    }
    assert public - errors == covered
    assert {name for name in ENTRANCES if len(places(name)) == 1} == OF_ONE_ARGUMENT


MASKS = (
    (r"setting an array element with a sequence.*?(?=; expected)", "…"),
    (r"unit '.*'(?= is unknown)", "unit …"),
    (r"frame '.*'(?= is not)", "frame …"),
    (r"no joint [^;]*", "no joint …"),
    (r"joint \S+(?= is not on)", "joint …"),
    (r"(?<=; )(frames|joints|its joints): .*", r"\1: …"),
    (r"^.*(?=: (?:no such file|is no name of|cannot be read|a folder))", "…"),
    (r"\((?:Is a|No such|File name|Invalid).*?\)", "(…)"),
    (r"\(\[[^)]*\]\)", "(…)"),
    (r"got .*?(?=, expected|;|$)", "got …"),
    (r"the first at index .*?(?=;)", "the first …"),
)
"""What refusals say of the values."""


def _words(error, place):
    """An error without the value: its argument is ``·``, and a number ``#``."""
    message = str(error)
    for pattern, replacement in MASKS:
        message = re.sub(pattern, replacement, message)
    message = re.sub(rf"\b{re.escape(place)}\b", "·", message)
    return f"{type(error).__name__}: {NUMBER.sub('#', message)}"


def _ranges(indices):
    """Indices in a few characters: 1 3-5."""
    runs = []
    for k in indices:
        if runs and runs[-1][1] == k - 1:
            runs[-1][1] = k
        else:
            runs.append([k, k])
    return " ".join(f"{first}" if first == last else f"{first}-{last}" for first, last in runs)


@pytest.mark.filterwarnings("ignore:preview:UserWarning")  # a short one is answered with it
def test_each_hostile_value_in_each_place_is_answered_or_refused(snapshot):
    """Which are answered, and in which words the others are refused, is held by a snapshot."""
    answered, refused = defaultdict(list), defaultdict(dict)
    for name, (good, _) in ENTRANCES.items():
        for place in places(name):
            taken = {kind: [] for kind in HOSTILE}
            for kind, values in HOSTILE.items():
                for k, value in enumerate(values):
                    if place in CALLED and callable(value):
                        continue  # what the caller's own function does is the caller's affair
                    errors = []
                    _check_arrays(_call(name, {**good(), place: value}, errors))
                    if not errors:
                        taken[kind].append(k)
                    for error in errors:
                        refused[_words(error, place)][f"{name} {place}"] = None
            told = ", ".join(f"{kind} {_ranges(ks)}" for kind, ks in taken.items() if ks)
            answered[told].append(f"{name} {place}")
    lines = [f"answered {taken or 'none'}: {', '.join(of)}" for taken, of in answered.items()]
    lines += [f"{words} | {', '.join(of)}" for words, of in refused.items()]
    snapshot.check("refusals", "\n".join(lines) + "\n")


@pytest.mark.filterwarnings("ignore:preview:UserWarning")  # a short one is answered with it
@pytest.mark.parametrize("name", [name for name in ENTRANCES if name not in OF_ONE_ARGUMENT])
@settings(max_examples=20)
@given(data=st.data())
def test_hostile_values_in_several_places_are_answered_or_refused(name, data):
    good = ENTRANCES[name][0]
    chosen = st.lists(st.sampled_from(places(name)), min_size=2, max_size=4, unique=True)
    hostile = {place: data.draw(ANYTHING, label=place) for place in data.draw(chosen)}
    assume(not any(callable(hostile.get(place)) for place in CALLED))
    _check_arrays(_call(name, {**good(), **hostile}))


@pytest.mark.parametrize("name", ENTRANCES)
def test_good_arguments_with_read_only_arrays_are_answered_and_left_as_they_were(name):
    arguments = ENTRANCES[name][0]()
    before = {}
    for place, value in arguments.items():
        if isinstance(value, np.ndarray):
            arguments[place] = value.copy()
            arguments[place].setflags(write=False)
            before[place] = value.copy()
    answer = _call(name, arguments)
    assert answer is not None or MISSING in arguments.values()
    _check_arrays(answer)
    for place, value in before.items():
        assert np.array_equal(arguments[place], value)
