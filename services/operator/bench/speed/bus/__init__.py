"""`crosspih bench bus`: the typed bus compared with its transport, in the same processes, in turn."""
