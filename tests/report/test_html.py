"""HTML pages and tables."""

from nlpgrasp.report.html_parts import Html, html_table
from nlpgrasp.report.page_builder import page


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
