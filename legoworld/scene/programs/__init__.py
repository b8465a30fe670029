"""Scene programs: run in a sandbox, with a verdict and a record of how they ended."""
