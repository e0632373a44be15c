"""The sessions of years: an index of session files, what is asked of it, and what many sessions say together."""
