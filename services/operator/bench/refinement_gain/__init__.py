"""`crosspih bench refine`: how refining over past recordings changes the next assemblies."""
