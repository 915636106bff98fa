"""Shared by the tests of plugins."""

from __future__ import annotations

import pytest

from ancf2d import extend
from ancf2d.case import Case
from ancf2d.case.records import keys_of
from ancf2d.extend import plugins


@pytest.fixture
def registries(monkeypatch):
    """Remove the declarations of plugins after a test."""
    monkeypatch.setenv(plugins.VARIABLE, "")
    kept = [extend.FORMULATIONS, *(keys_of(Case)[k].kind.item.known for k in ("springs", "loads"))]
    copies = [dict(table) for table in kept]
    yield
    for table, copy in zip(kept, copies, strict=True):
        table.clear()
        table.update(copy)
    plugins._load_file.cache_clear()
