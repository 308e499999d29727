"""Everything that request-planner raises on purpose.

::

    PlannerError
    ├── InvalidInput (a ValueError too)   an argument cannot be used; says what to do
    │   ├── InvalidModel                  a joint that cannot exist or cannot come to rest
    │   ├── InvalidTrajectory             NaN, wrong shape, too short
    │   ├── InvalidFile                   invalid content; carries path and line
    │   ├── Infeasible                    requirements that contradict each other
    │   ├── UnsupportedLeg                no leg between the two frames, or a joint that never moves
    │   │                                 its foot
    │   ├── UnreachableFoot               points out of the leg's reach; carries their distances
    │   └── MissingExtra                  the call needs a package that is not installed
    ├── BusError                          servos that do not answer, do not follow or report a fault
    ├── NoSteadyCycle                     a cycle that never closes; carries the mismatch
    └── SolverFailed                      a solver stopped short; carries problem and status

    OutsideEquation13 (a UserWarning)     the paper's rule, where the paper does not derive it

The command line turns ``InvalidInput`` into exit status 2 and the others into exit status 1.
"""

from __future__ import annotations

import copyreg
import math
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from planner.arrays import Array, Indices

LONGEST = 1500
"""Characters of a message; of a longer one the middle is left out."""


class PlannerError(Exception):
    """The root of the tree; its message is one line, whatever the caller's names hold."""

    def __str__(self) -> str:
        return printable(super().__str__())

    def __reduce__(self) -> tuple[object, ...]:
        """Pickle it without its constructor, which composes the message, for other processes."""
        return copyreg.__newobj__, (type(self), *self.args), vars(self)  # type: ignore[attr-defined]


class InvalidInput(PlannerError, ValueError):
    """An argument cannot be used: the message says which, the expected value and what to do."""


class InvalidModel(InvalidInput):
    """The parameters describe no joint."""


class InvalidTrajectory(InvalidInput):
    """A trajectory is not a finite one-dimensional array that is long enough."""


class InvalidFile(InvalidInput):
    """The content of a file is invalid.

    Attributes:
        path: The file, or ``-`` for standard input.
        line: The line of the fault, counted from 1; None where no single line is at fault.
    """

    def __init__(self, path: Path | str, problem: str, *, line: int | None = None) -> None:
        """Compose the message from the place and the problem."""
        self.path = path
        self.line = line
        place = f"{path}" if line is None else f"{path}, line {line}"
        super().__init__(f"{place}: {problem}")


class Infeasible(InvalidInput):
    """No answer can meet the requirements."""


class UnsupportedLeg(InvalidInput):
    """The joints between the two frames form no leg, or none with an inverse."""


class UnreachableFoot(InvalidInput):
    """The leg cannot reach some of the points within its joint limits.

    Attributes:
        indices: Which points, read-only, shape (m,).
        distances: How far each lies from the nearest point that can be reached [m], read-only,
            shape (m,).
    """

    def __init__(self, indices: Indices, distances: Array, *, of: int) -> None:
        """Name the points, as far as they fit on a line, and the worst of them."""
        self.indices = indices
        self.distances = distances
        listed = ", ".join(str(index) for index in indices[:10])
        more = ", ..." if len(indices) > 10 else ""
        worst = int(distances.argmax())
        super().__init__(
            f"{len(indices)} of {of} foot positions are out of reach, the worst by "
            f"{distances[worst]:.3g} m (index {indices[worst]}); indices: {listed}{more}; move "
            "them (are they in metres, in the base frame?), or ask for unreachable='nearest'"
        )


class MissingExtra(InvalidInput):
    """The call needs a package that is not installed.

    Attributes:
        extra: The extra of request-planner that installs it.
    """

    def __init__(self, what: str, extra: str) -> None:
        """Say how to install it."""
        self.extra = extra
        super().__init__(
            f"{what} needs the extra '{extra}': python -m pip install 'request-planner[{extra}]', "
            f"or '.[{extra}]' in a checkout"
        )


class BusError(PlannerError):
    """A servo bus is gone, or a servo does not answer, does not follow or reports a fault."""


class NoSteadyCycle(PlannerError):
    """The joint does not settle into a cycle under these requests.

    Attributes:
        mismatch: Distance between the two ends of the last cycle [rad].
        cycles: Number of cycles that were run.
    """

    def __init__(self, mismatch: float, cycles: int) -> None:
        """Say how far from closed the cycle still is."""
        self.mismatch = mismatch
        self.cycles = cycles
        super().__init__(
            f"no steady cycle after {cycles} cycles: its ends are {angle_text(mismatch)} apart; "
            "under these requests the joint drifts or, with inertia, rings; bring them closer to "
            "its range, make them smoother, or simulate from rest (cyclic=False)"
        )


class SolverFailed(PlannerError):
    """A solver stopped without an answer that can be trusted.

    Attributes:
        problem: The problem being solved.
        status: The solver's own status.
        violation: Largest violation of a constraint, in the problem's unit; None where unknown.
    """

    def __init__(self, problem: str, status: str, *, violation: float | None = None) -> None:
        """Compose the message from the problem, the status and the violation."""
        self.problem = problem
        self.status = status
        self.violation = violation
        worst = "" if violation is None else f"; worst constraint violated by {violation:.3g}"
        super().__init__(f"{problem}: the solver stopped with status '{status}'{worst}")


class OutsideEquation13(UserWarning):
    """The paper's rule for lines is used for a joint that breaks Equation 13."""


def angle_text(*radians: float, digits: int = 6) -> str:
    """An angle, or one to another, in a message [rad]."""
    return f"{' to '.join(f'{each:.{digits}g}' for each in radians)} rad"


def in_degrees(error: BaseException, unit: str = "deg") -> str:
    """An error's message in degrees, or in percent where one is scaled as a degree.

    Messages about models and files stay as they are: their parameters are in radians.
    """
    message = str(error)
    if not isinstance(error, PlannerError) or isinstance(error, InvalidFile | InvalidModel):
        return message
    number = r"(?<![\w.-])-?(?:inf|nan|\d+(?:\.\d*)?(?:e[+-]?\d+)?)"

    def converted(each: re.Match[str]) -> str:
        digits = 5 if len(re.sub(r"e.*|\D", "", each[1]).lstrip("0")) > 2 else 3
        return f"{math.degrees(float(each[1])):.{digits}g}{each[2] or f' {unit}'}"

    message = re.sub(rf"({number}) to (?={number} rad\b)", r"\1 rad to ", message)
    return re.sub(rf"({number}) rad\b(?!\^)( to)?", converted, message)


def nearest(name: str, names: Sequence[str]) -> str:
    """A hint for a misspelt name: ``(did you mean 'knee'?)``, or nothing."""
    import difflib

    close = difflib.get_close_matches(name, names, n=1)
    return f" (did you mean '{close[0]}'?)" if close else ""


@contextmanager
def about(joint: str) -> Iterator[None]:
    """Let errors inside the block name a joint, as a note; "" is no joint."""
    try:
        yield
    except PlannerError as error:
        if joint and joint not in getattr(error, "__notes__", ()):
            error.add_note(joint)
        raise


@contextmanager
def importing(what: str, extra: str) -> Iterator[None]:
    """Let imports inside the block that fail name the extra which has the package."""
    try:
        yield
    except ImportError as error:
        raise MissingExtra(what, extra) from error


def printable(text: str) -> str:
    """Text on one line and of bounded length, for any content of files and arguments."""
    text = _shortened(text)
    return _shortened("".join(c if c.isprintable() else repr(c)[1:-1] for c in text))


def _shortened(text: str) -> str:
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 300]} … {text[-300:]}"
