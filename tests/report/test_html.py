"""HTML pages and tables."""

import nlpgrasp as ng
from nlpgrasp.report import write_report
from nlpgrasp.report.html_parts import Html, html_table
from nlpgrasp.report.page_builder import page
from tests.held_block import held_block


def test_a_page_escapes_its_title_and_keeps_its_parts():
    text = page("a < b", "p { color: red; }", ["<h1>one</h1>", "<p>two</p>"], "<link>", "<script>1 < 2</script>")
    assert text.startswith("<!doctype html>\n")
    assert "<title>a &lt; b</title>" in text
    assert 'initial-scale=1"><link>\n<style>p { color: red; }</style>' in text
    assert text.endswith("<h1>one</h1>\n<p>two</p>\n</main><script>1 < 2</script></body></html>\n")


def test_cells_are_escaped_unless_they_are_html():
    text = html_table("a & b", ["x<y", ""], [["1 < 2", Html("<b>3</b>")]])
    assert "<caption>a &amp; b</caption>" in text
    assert '<th scope="col">x&lt;y</th><th scope="col"></th>' in text
    assert "<td>1 &lt; 2</td><td><b>3</b></td>" in text


def test_a_table_without_caption_and_focus():
    assert "<caption>" not in html_table("", ["x"], [["1"]])
    assert html_table("", ["x"], [["1"]]).startswith('<div class="wide" tabindex="0">')
    assert html_table("", ["x"], [["1"]], focusable=False).startswith('<div class="wide"><table>')


def test_names_are_text_and_no_markup(tmp_path):
    """Names of problem and constraints, and messages, of a file that someone sends."""
    markup = '"><script>alert(1)</script></script><img src=x onerror=alert(1)>'

    def marked(value, key=""):
        if isinstance(value, dict):
            return {name: marked(item, name) for name, item in value.items()}
        if isinstance(value, list):
            return [marked(item, key) for item in value]
        return f"{value}{markup}" if isinstance(value, str) and key == "name" else value

    solution = ng.GraspSolution.from_dict(marked(held_block().to_dict()))
    text = write_report({markup: solution}, tmp_path / "page.html").read_text(encoding="utf-8")
    assert "alert(1)" in text
    assert "<script>alert" not in text
    assert "<img src=x" not in text
