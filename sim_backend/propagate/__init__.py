"""A linear rig with extra forces in its elements, carried along in time: compiled.

The linear rig is stepped exactly (`exact_step`). Over a step an extra force is the parabola through its
last three values, which leaves an error of third order in the step times the extra force alone. Where that parabola
does not hold, because a law bends abruptly or a motion has just begun, the step is divided by four, up to three
times, until the force's third difference is small again. Where a force jumps with the speed, an element turns about or
stops within the step.
"""

from sim_backend.propagate.inputs import Clock, Given, Impact, Laws, Rigs, laws_of
from sim_backend.propagate.propagator import TOLERANCE, Division, Motion, propagate

__all__ = ["TOLERANCE", "Clock", "Division", "Given", "Impact", "Laws", "Motion", "Rigs", "laws_of", "propagate"]
