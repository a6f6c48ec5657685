"""Reports: solutions as a page, and as pictures; a hand as a page."""

from nlpgrasp.report.hand.page import write_hand
from nlpgrasp.report.solution.page import write_report
from nlpgrasp.report.solution.pictures import write_pictures

__all__ = ["write_hand", "write_pictures", "write_report"]
