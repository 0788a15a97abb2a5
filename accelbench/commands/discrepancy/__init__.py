"""`discrepancy thermal` and `discrepancy rig`."""
