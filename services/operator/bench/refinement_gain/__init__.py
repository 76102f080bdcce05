"""`crosspih bench refine`: what refining over past recordings makes of the next assemblies."""
