"""Networks to compare the estimator with: `paper` (one wrench to three angles) and `sequence` (a history of touches to
a pose); `python -m services.inference.network` makes their data, trains and evaluates them."""
