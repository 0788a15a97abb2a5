"""Error model of a SINS: terms, priors, effects."""
