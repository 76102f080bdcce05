"""Where to touch next: `by_rule` arm by arm, `by_information` by the largest expected reduction of the posterior."""
