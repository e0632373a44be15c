"""A driver, a file format and a mechanism for mesotap."""
