"""``request-planner virtual-bus``: which servos it serves, with which faults."""

from __future__ import annotations

from contextlib import contextmanager
from types import SimpleNamespace

import pytest

from planner.virtual import servo_bus
from planner.virtual.servo_bus import KINDS, Faults

ASKED = {
    "": (6, "sts3215", Faults(), None),
    "--servos 2 --step-ms 20": (2, "sts3215", Faults(), 0.02),
    "--protocol dynamixel": (6, "xl430", Faults(), None),
    "--protocol xl320": (6, "xl-320", Faults(), None),
    "--kind mx-64 --protocol dynamixel": (6, "mx-64", Faults(), None),
    "--fault drop=1 --fault disconnect=0 --fault power-off=3.5": (
        6,
        "sts3215",
        Faults(drop=1.0, disconnect=0.0, power_off=3.5),
        None,
    ),
    "--fault stall=1@5 --fault stall=6@0.5 --fault overheat=3@7 --fault saturate=2@1": (
        6,
        "sts3215",
        Faults(stall={1: 5.0, 6: 0.5}, overheat={3: 7.0}, saturate={2: 1.0}),
        None,
    ),
}
"""What is asked for; the servos, their kind, their faults, and the time of a step [s]."""


@pytest.mark.parametrize("asked", ASKED, ids=lambda asked: asked or "nothing")
def test_the_servos_that_are_asked_for_are_served_at_the_port_that_is_printed(
    run, monkeypatch, asked
):
    made, served = [], []

    def servos(*given, **more):
        made.append((*given, more))
        return SimpleNamespace(run=lambda _: None)

    @contextmanager
    def terminal():
        yield 7, "/dev/pts/9"

    monkeypatch.setattr(servo_bus, "VirtualServos", servos)
    monkeypatch.setattr(servo_bus, "terminal", terminal)
    monkeypatch.setattr(servo_bus, "serve", lambda _, end: served.append(end))
    result = run("virtual-bus", *asked.split())
    count, kind, faults, step = ASKED[asked]
    assert result.stdout == "/dev/pts/9\n"
    assert served == [7]
    assert made == [(count, KINDS[kind], {"faults": faults, "step": pytest.approx(step)})]


@pytest.mark.parametrize(
    "fault", ["drop=1.01", "drop=-0.1", "disconnect=-1", "power-off=inf", "stall=0@1", "stall=7@1"]
)
def test_a_fault_that_cannot_be_is_refused_before_anything_is_served(run, monkeypatch, fault):
    monkeypatch.setattr(servo_bus, "VirtualServos", None)
    result = run("virtual-bus", "--fault", fault)
    assert (result.exit_code, result.stdout) == (2, "")
    assert result.stderr.startswith("request-planner: --fault: got ")
