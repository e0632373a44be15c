"""The tester that is not there: Eq. 9 of the paper, and `sim_backend.rig.SimulatedRig` around it."""
