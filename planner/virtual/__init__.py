"""A robot in simulation: the front leg of the ERS-210A in MuJoCo, driven by physical servos."""
