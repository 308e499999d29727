"""Section 3 of the paper: from requested and actual angles to a joint model."""
