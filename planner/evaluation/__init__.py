"""Section 5 of the paper: against what, and how well."""
