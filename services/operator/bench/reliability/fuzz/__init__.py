"""`crosspih bench fuzz`: payloads drawn from the real schemas, valid, absurd and broken, on every key."""
