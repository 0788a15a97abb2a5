"""What people ask of tests, and what they are told: commands, controllers, plans, alarms."""
