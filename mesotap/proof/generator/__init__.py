"""Sessions with a concealed effect, by code that shares nothing with the program it judges but the file format.

`import-linter` holds that nothing here imports `sim_backend` or `analysis`.
"""
