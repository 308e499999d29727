"""Section 3 of the paper: how a joint answers."""
