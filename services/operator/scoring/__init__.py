"""How well assemblies did: a score for each, and what many come to. Pure."""
