"""Where to touch next: `by_rule` arm by arm, `by_information` what should narrow the posterior most."""
