"""Frequency responses from a measured force: H1, H2, Hv, coherence, and Eq. 9 fitted to them."""
