"""`accelbench discrepancy rig`."""
