"""The tester that is not there: Eq. 9 of the paper, and a simulated `rig.Rig` around it."""

from sim_backend.recorder import analog_filter
from sim_backend.rig import SimulatedRig
from sim_backend.ring_down import RingDown, ring_down_linear
from sim_backend.two_mass import TwoMass

__all__ = ["RingDown", "SimulatedRig", "TwoMass", "analog_filter", "ring_down_linear"]
