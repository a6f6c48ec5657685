"""The page's tables are those of the stored results."""

from pathlib import Path

from benchmarks.peers.cases import CASES
from benchmarks.peers.results import RESULTS, read
from benchmarks.peers.tables import by_body, by_method


def test_the_page_holds_the_tables_of_the_stored_results():
    rows = read(RESULTS)
    page = (Path(__file__).resolve().parents[3] / "docs" / "comparison.md").read_text()
    assert {row.body for row in rows} == set(CASES)
    assert by_method(rows) in page
    assert by_body(rows) in page
