"""The package as it is shipped: generated files, types, version."""

import re
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import covis
import pytest

ROOT = Path(__file__).resolve().parents[2]


def run(*command):
    ran = subprocess.run(command, cwd=ROOT / "python", capture_output=True, text=True)
    assert ran.returncode == 0, ran.stdout + ran.stderr


def test_what_is_generated_is_of_the_protos_and_signatures_as_they_are():
    pytest.importorskip("grpc_tools")
    run(sys.executable, "generate.py", "--check")


def test_the_package_and_typical_calls_are_well_typed():
    pytest.importorskip("mypy")
    run(sys.executable, "-m", "mypy")


def test_the_version_is_that_of_the_crates():
    manifest = (ROOT / "Cargo.toml").read_text()
    wanted = re.search(r'^version = "([^"]+)"', manifest, re.M)
    assert version("covis") == covis.__version__ == wanted[1]
