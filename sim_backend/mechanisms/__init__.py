"""Physics that a linear rig leaves out, a file each: a further one is a file that ends in ``MECHANISM = ...``.

``MECHANISM`` is one of the kinds of `sim_backend.mechanisms.kinds`, or a tuple of variants of one id and component
that fit different elements. docs/mechanisms.md says how to write one.
"""
