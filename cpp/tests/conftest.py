"""The fixtures of the Python package's tests, with the C++ client as the one that is tested."""

from __future__ import annotations

import os
import runpy
import sys
from pathlib import Path

import pytest

PYTHON_TESTS = Path(__file__).resolve().parents[2] / "python" / "tests"
sys.path.insert(0, str(PYTHON_TESTS))
pytest.register_assert_rewrite("test_outages", "test_session", "test_documents", "test_servers")

from client import Client  # noqa: E402

# `from conftest import …` in those tests finds this file: it has what theirs has.
_theirs = runpy.run_path(str(PYTHON_TESTS / "conftest.py"))
GUARD_S, Server = _theirs["GUARD_S"], _theirs["Server"]
server, client, proxy, linked = (_theirs[name] for name in ("server", "client", "proxy", "linked"))


@pytest.fixture
def connect():
    """Connects the client that the scenarios are about."""
    assert os.environ.get("COVIS_CPP_DRIVER"), "set COVIS_CPP_DRIVER to covis_driver; cpp/check does"
    return Client
