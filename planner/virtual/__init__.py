"""Robots in simulation on physical servos, in MuJoCo: the ERS-210A's front leg, a pendulum."""
