"""The tester that is not there: Eq. 9 of the paper, and a simulated `rig.Rig` around it."""
