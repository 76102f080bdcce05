"""The service on the bus: `service` answers, `plausible` refuses, `own` calls a user's own estimator or network."""
