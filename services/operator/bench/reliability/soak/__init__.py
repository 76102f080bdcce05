"""`crosspih bench soak`: assemblies for an hour, and whether memory, latency and disk stay where they are."""
