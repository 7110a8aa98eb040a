"""Design variables, objectives, constraints and optimizers; installed as `beltjax.optimize`."""
