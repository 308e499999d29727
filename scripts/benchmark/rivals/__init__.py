"""Rival methods of inverting a joint, each as well as it can be written.

Every rival is a module with ``build(model, samples)``: the work done once for a joint and a length.
It returns ``solve(desired, limits, start)``, all in radians, which returns the requests of a
cycle. ``start`` are requests from which to set out.
"""
