"""`crosspih bench busy`: assemblies while other processes keep the machine busy."""
