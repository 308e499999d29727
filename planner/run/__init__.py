"""A whole run: from a file of settings, through the plan, to a folder of results."""
