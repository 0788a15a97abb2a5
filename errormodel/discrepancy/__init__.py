"""Finding and naming a missing effect: the engine, which knows no chamber and no rig."""
