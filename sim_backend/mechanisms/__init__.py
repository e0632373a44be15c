"""Physics beyond Eq. 9, a file each: to add a mechanism is to add a file here that ends in ``MECHANISM = ...``."""
