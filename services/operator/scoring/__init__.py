"""How well assemblies went: the score of each, and the statistics of many. Pure."""
