"""`combine`."""
