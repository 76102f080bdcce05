"""`crosspih bench fuzz`: payloads drawn from the real schemas, sound, absurd and broken, at every key."""
