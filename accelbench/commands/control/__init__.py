"""`accelbench control`: pause, resume and abort a running test; alarms, queue, notices."""
