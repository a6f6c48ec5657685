"""Reports: solutions as a page, and as pictures."""

from nlpgrasp.report.solution.page import write_report
from nlpgrasp.report.solution.pictures import write_pictures

__all__ = ["write_pictures", "write_report"]
