"""Where ring-downs hold more than a model: maps, windows of time and amplitude, the force without a law."""
