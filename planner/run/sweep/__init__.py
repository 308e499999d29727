"""Sweeps: plans over ranges of gaits or speeds, and the best of them."""
