"""One HTML page about one recorded assembly."""

from services.operator.report.page import make_report

__all__ = ["make_report"]
