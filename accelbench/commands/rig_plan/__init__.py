"""`rig simulate` and `rig covariance`."""
