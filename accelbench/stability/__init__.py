"""`stability`."""
