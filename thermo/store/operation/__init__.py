"""Operation of tests by people: commands, controllers, plans, alarms."""
