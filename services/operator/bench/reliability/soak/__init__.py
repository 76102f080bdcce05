"""`crosspih bench soak`: assemblies for an hour, and whether memory, latency and disk use stay constant."""
