"""Free decays after taps: what is fitted of them, how candidates are fitted and judged, what they say."""
