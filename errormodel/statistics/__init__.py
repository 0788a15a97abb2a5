"""Statistics: robust estimates, variance components, control charts."""
