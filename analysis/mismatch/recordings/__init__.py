"""Recordings that are simulated from end to end: what is fitted, how candidates are judged, what they say."""
