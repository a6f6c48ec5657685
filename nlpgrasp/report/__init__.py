"""Reports of bodies, hands, problems and solutions: HTML pages and pictures."""

from nlpgrasp.report.hand_page import write_hand
from nlpgrasp.report.pictures import write_pictures
from nlpgrasp.report.solution_page import write_report

__all__ = ["write_hand", "write_pictures", "write_report"]
