"""Finding and naming a missing effect, independent of chamber and rig."""
