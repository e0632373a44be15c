"""Diagnosis of any described rig from recordings of any quantity, with measured inputs, a tap, or none.

Unlike the tester's sessions of many short impacts, these are a few long recordings: they are simulated from end to end,
and everything is judged by the error of that simulation.
"""
