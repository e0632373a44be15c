"""Physics that an element or channel of any rig may hold, a file each; parameters are in the units of that rig.

The two-mass tester's own mechanisms, a folder up, are measured by its contact: preload, k_c and c_c.
"""
