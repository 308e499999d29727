"""Logs of requested and actual angles, a module per format."""
