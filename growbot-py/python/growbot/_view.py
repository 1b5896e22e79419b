"""The page of a body, outside of a notebook."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Optional, Protocol, Union


class Viewable(Protocol):
    """A body that has a page."""

    def html(self) -> str: ...


def view(body: Viewable, file: Optional[Union[str, os.PathLike[str]]] = None, *, browser: bool = True) -> Path:
    """Writes the page of a plan, a simulated growth or a run to a file, and opens it in the browser.

    The default file is in the directory for temporary files. Returns the path of the file. In a notebook, a cell that
    ends with a body shows it.
    """
    import tempfile

    page = body.html()
    if file is None:
        with tempfile.NamedTemporaryFile("w", suffix=".html", prefix="growbot-", delete=False) as temporary:
            temporary.write(page)
        place = Path(temporary.name)
    else:
        place = Path(file)
        place.write_text(page, encoding="utf-8")
    if browser:
        import webbrowser

        webbrowser.open(place.resolve().as_uri())
    return place
