"""The benchmark behind ``scripts/bench``: public names only, each part a table."""
