"""Devices that are not there, at their wire: the simulated rig's physics behind the real protocols."""
