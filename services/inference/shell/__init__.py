"""The service on the bus: `service` answers, `plausible` refuses, `own` calls somebody's own estimator or network."""
