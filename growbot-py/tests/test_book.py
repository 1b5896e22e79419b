"""Runs the code of the book's two pages on Python, from the first block to the last."""

from __future__ import annotations

import os
import re
import webbrowser
from pathlib import Path

import pytest
from distributed import Client, LocalCluster

from conftest import ROOT

BLOCK = re.compile(r"^```python\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def test_the_pages_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(webbrowser, "open", lambda _: True)
    pages = [ROOT / "book/src" / page for page in ("python.md", "campaigns.md")]
    blocks = [block for page in pages for block in BLOCK.findall(page.read_text())]
    assert len(blocks) >= 5
    names: dict[str, object] = {}
    with LocalCluster(n_workers=1, threads_per_worker=2, processes=False, dashboard_address=None) as cluster:
        for block in blocks:
            exec(block.replace('"tcp://scheduler:8786"', repr(cluster.scheduler_address)), names)
    client = [value for value in names.values() if isinstance(value, Client)]
    assert not client and len(os.listdir("growths")) >= 1
    summary = names["summary"]
    assert names["result"] is not None and getattr(summary, "growth_count") == 1000
