"""`crosspih bench bus`: the typed bus beside what carries it, in the same processes, in turn."""
