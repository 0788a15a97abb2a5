"""An effect without a name: a smooth function of one quantity."""
