"""The strain gauge, calibrated before and after a test."""
