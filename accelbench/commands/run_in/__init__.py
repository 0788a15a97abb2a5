"""`runin`."""
