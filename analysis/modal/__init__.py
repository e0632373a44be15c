"""Modal identification of ring-downs."""
