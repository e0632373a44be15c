"""The operator's terminal: what is shown there, what is asked, and the keys and signals that are heeded."""
