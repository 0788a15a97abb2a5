"""`accelbench panel`: the operator's page in a browser."""
