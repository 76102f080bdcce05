"""One HTML page about a training."""

from services.operator.training_report.page import PAPER_LEAVE_ONE_OUT_DEG, write_training_report

__all__ = ["PAPER_LEAVE_ONE_OUT_DEG", "write_training_report"]
