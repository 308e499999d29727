"""Requests while the desired path becomes known: one optimised step at every period."""
