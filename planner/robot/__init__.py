"""From requests to a robot: schedules, resampling and playback."""

BUSES = ("virtual", "feetech", "dynamixel", "xl320", "lerobot")  # types of a bus
KINDS = ("sts3215", "xl430", "xl330", "mx-64", "mx-106", "xl-320")
"""Virtual servos: those of ``planner.virtual.servo_bus``, which takes longer to import."""

EXPECTED_BUS = (
    f"{', '.join(BUSES[:-1])}, lerobot:ROBOT such as lerobot:so101, or virtual:KIND with one of "
    f"{', '.join(KINDS)}"
)
"""The names of a bus, in words."""


def bus_name(text: object) -> str | None:
    """The name of a bus, perhaps with a kind of virtual servo or a robot of LeRobot; else None."""
    kind, colon, which = str(text).partition(":")
    special = {"virtual": not colon or which in KINDS, "lerobot": bool(which)}
    return str(text) if special.get(kind, kind in BUSES and not colon) else None
