"""Drivers of real devices, in three layers: transport (bytes), protocol (framing, commands, codes), device (SI units).

Nothing here is imported until a configuration asks for it, so that analysis starts no hardware code.
"""
