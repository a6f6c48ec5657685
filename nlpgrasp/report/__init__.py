"""Reports: solutions as a page, and as pictures."""

from nlpgrasp.report.page import write_report

__all__ = ["write_report"]
