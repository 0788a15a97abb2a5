"""`import`, `fit` and `compensate`."""
