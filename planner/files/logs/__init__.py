"""Logs of requested and actual angles, by format."""
