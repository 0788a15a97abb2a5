"""Orders of the model that the readings support."""
