"""What every test of the engine has: a folder of its own to work in."""

from pathlib import Path

import pytest


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch, request):
    """Work in an empty folder, which holds the ``CONFIG`` of the test's file as sweep.yaml."""
    monkeypatch.chdir(tmp_path)
    if hasattr(request.module, "CONFIG"):
        Path("sweep.yaml").write_text(request.module.CONFIG)
    return tmp_path
