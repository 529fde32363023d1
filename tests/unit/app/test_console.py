from io import StringIO

from rich.console import Console

from dlokit.app.console import say


def test_a_line_is_printed_as_it_is_whatever_brackets_its_names_have_and_however_long_it_is():
    out = StringIO()
    line = f"figures: runs/[bold]cable[/bold]/{'x' * 200}.json"
    say(Console(file=out, force_terminal=True, width=80), line)
    assert out.getvalue() == f"{line}\n"
