"""Reports of bodies, hands, problems and solutions: HTML pages and pictures."""

from nlpgrasp.report.hand.page import write_hand
from nlpgrasp.report.solution.page import write_report
from nlpgrasp.report.solution.pictures import write_pictures

__all__ = ["write_hand", "write_pictures", "write_report"]
