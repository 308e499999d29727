"""Physical servos in simulation: the ERS-210A's front leg in MuJoCo, and servos on a bus."""
