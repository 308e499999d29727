"""Section 3 of the paper: the response of a joint."""
