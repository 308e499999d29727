"""Reference results behind ``scripts/reference``: recorded by public names only, and compared."""
