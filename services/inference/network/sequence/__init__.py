"""The sequence network: from the history of touches to a Gaussian over the hole's pose."""
