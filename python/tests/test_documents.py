"""The tutorial, the how-tos and the page on accuracy: every command in them is run, in their order.

The word behind a block's language says what it is:

- `sh,server`: runs beside all that follows, until the page ends;
- `sh,run`: runs in bash and must succeed; `text,output` behind it must be in what it prints;
- `sh,example`: an example of the workspace, run as it was built (skipped where it was not);
- `sh,setup`: brings compilers and packages; the gate builds and installs the same before the tests;
- `python,file=NAME`: what the reader saves as NAME.

A page's folder is empty but for what its reader has: the checkout, and the environment of Python.
"""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import GUARD_S

ROOT = Path(__file__).resolve().parents[2]
URL = "http://127.0.0.1:7411"
BLOCK = re.compile(r"^```(\S*)\n(.*?)^```$", re.M | re.S)
EXAMPLE = re.compile(r"cargo run --release --manifest-path covis/Cargo.toml --example (\w+)(.*)")


class Page:
    """A reader who follows a page."""

    def __init__(self, folder):
        self.folder = folder
        program = Path(os.environ.get("COVIS_BIN") or shutil.which("covis")).absolute()
        # Under its own name, whatever the binary is called.
        (folder / ".bin").mkdir()
        (folder / ".bin" / "covis").symlink_to(program)
        (folder / "covis").symlink_to(ROOT)
        (folder / "tests").symlink_to(ROOT / "tests")
        (folder / "venv").symlink_to(sys.prefix)
        self.debug = program.parent
        self.server = None
        self.url = URL
        self.environment = {k: v for k, v in os.environ.items() if not k.startswith("COVIS_")}
        self.environment["PATH"] = f"{folder / '.bin'}:{os.environ['PATH']}"

    def serve(self, command):
        """Starts the server on a free port; all that follows means this one."""
        listens = self.environment | {"COVIS_LISTEN": "127.0.0.1:0"}
        log = open(self.folder / "server.log", "wb")
        self.server = subprocess.Popen(
            ["bash", "-c", f"exec {command}"], cwd=self.folder, env=listens, stdout=subprocess.PIPE,
            stderr=log, text=True,
        )  # fmt: skip
        first = self.server.stdout.readline()
        assert first.startswith("listening on "), (self.folder / "server.log").read_text()
        self.url = first.split()[-1]
        self.environment["COVIS_SERVER"] = self.url
        second = self.server.stdout.readline()
        return first.replace(self.url, URL) + second

    def run(self, commands):
        done = subprocess.run(
            ["bash", "-euo", "pipefail", "-c", commands.replace(URL, self.url)], cwd=self.folder,
            env=self.environment, stdin=subprocess.DEVNULL, capture_output=True, text=True,
            timeout=10 * GUARD_S,
        )  # fmt: skip
        assert done.returncode == 0, f"{commands}\n{done.stdout}\n{done.stderr}"
        return done.stdout

    def example(self, command):
        name, arguments = EXAMPLE.fullmatch(command.strip()).groups()
        program = self.debug / "examples" / name
        if not program.exists():
            return None
        return self.run(f"{program} {arguments or self.url}")

    def stop(self):
        if self.server is not None:
            self.server.terminate()
            self.server.wait(GUARD_S)
            self.server.stdout.close()


@pytest.fixture
def page(tmp_path):
    reader = Page(tmp_path)
    yield reader
    reader.stop()


def squeezed(text):
    """Without the widths of columns."""
    return [" ".join(line.split()) for line in text.splitlines() if line.strip()]


@pytest.mark.parametrize("name", ["tutorial", "how-to", "accuracy"])
def test_a_reader_who_follows_a_page_word_for_word_gets_there(page, name):
    printed, count = "", 0
    for kind, text in BLOCK.findall((ROOT / "docs" / f"{name}.md").read_text()):
        if kind == "sh,server":
            printed = page.serve(text.strip())
        elif kind == "sh,run":
            printed = page.run(text)
        elif kind == "sh,example":
            printed = page.example(text)
        elif kind.startswith("python,file="):
            (page.folder / kind.split("=")[1]).write_text(text.replace(URL, page.url))
        elif kind == "text,output":
            for line in squeezed(text):
                assert printed is None or any(line in found for found in squeezed(printed)), (line, printed)
        else:
            assert kind == "sh,setup", f"```{kind} says not whether it is run"
        count += kind.startswith("sh,") and kind != "sh,setup"
    assert count >= 3
