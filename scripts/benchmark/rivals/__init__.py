"""What else one could write to invert a joint, each as well as it can be written.

Every rival is a module with ``build(model, samples)``: what is paid once for a joint and a length.
It gives back ``solve(desired, limits, start)``, all in radians, which returns the requests of a
cycle. ``start`` are requests from which to set out.
"""
