"""One HTML page about a training."""

from services.operator.training_report.page import render_training, write_training_report

__all__ = ["render_training", "write_training_report"]
