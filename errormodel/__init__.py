"""The core: an error model is a tuple of named terms."""
