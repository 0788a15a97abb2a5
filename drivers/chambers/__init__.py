"""Chamber controllers: recognition, limits, watch, one class a model."""
