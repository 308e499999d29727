"""From requests to a robot: schedules, resampling and playback."""

BUSES = ("virtual", "feetech", "dynamixel", "xl320", "lerobot")
"""Types of a bus."""
