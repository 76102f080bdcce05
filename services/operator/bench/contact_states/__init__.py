"""Contact states produced on purpose in the cell: aimed, pushed, labelled by the true contact points,
and classified.
"""
