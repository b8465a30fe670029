"""LEGO-Bench for trainers and evaluators. Needs nothing but Python and a legoworld elsewhere."""
