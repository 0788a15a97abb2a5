"""Chamber models and results that rig commands share."""
