"""Contact states made on purpose in the cell: aimed, pushed, labelled by the true contact points, and judged."""
