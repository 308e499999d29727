"""Logs as people have them: requested against actual angles, a module per format."""
