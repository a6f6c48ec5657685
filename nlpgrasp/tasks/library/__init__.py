"""Libraries of task ellipsoids by name."""

from nlpgrasp.tasks.library.entry import Frame, ProvenanceRecord, TaskEntry
from nlpgrasp.tasks.library.library import TaskLibrary

__all__ = ["Frame", "ProvenanceRecord", "TaskEntry", "TaskLibrary"]
