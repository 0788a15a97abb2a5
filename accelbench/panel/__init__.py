"""The operator's page: plan, start, watch and stop tests in a browser."""
