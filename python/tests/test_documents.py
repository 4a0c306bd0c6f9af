"""The README and the pages of `PAGES`: every command in them is run, in their order.

The word behind a block's language says what it is:

- `sh,server`: runs beside all that follows, until the page ends or starts another server;
- `sh,run`: runs in bash and must succeed; `text,output` behind it must be in what it prints;
- `sh,setup`: the same, and brings programs and packages: from what this machine has, not from the network.
  `NOT_RUN` has the commands that are left out, and why;
- `sh,cpp`: the same, where the C++ client is built: `cpp/check` runs this test again for it;
- `python,file=NAME`, `cmake,file=NAME`, `toml,file=NAME`: what the reader saves as NAME;
- `console`: is shown only, because it needs what no test has: root, Docker, other machines, recordings.

A page's folder is empty but for what its reader has: the checkout, as `covis` and as the folder itself, and
where the page makes none itself the environment of Python.
"""

import os
import re
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest
from conftest import GUARD_S

ROOT = Path(__file__).resolve().parents[2]
URL = "http://127.0.0.1:7411"
BLOCK = re.compile(r"^```(\S*)\n(.*?)^```$", re.M | re.S)
# Where a server with TLS is reached on a page.
SECURE = re.compile(r"https://(?:localhost|127\.0\.0\.1):7411")
PAGE = "127.0.0.1:7412"
# The README, and pages of the book by their names.
PAGES = ["README", "install", "tutorial", "how-to", "command-line", "configuration", "accuracy"]
# Programs that take the server's URL, which is another one here than on the page.
PROGRAM = re.compile(r"^(cargo run|\S+/(?:first_frontend|robot))$", re.M)
NOT_RUN = {
    "cargo install --locked --path covis": "takes minutes; the gate has built the program that serves here",
    "cargo install --locked --path .": "the same",
    "cargo run --release -- demo": "the same; a test of its own runs the demo",
    "cargo test --workspace": "the gate does",
    "apt-get install cmake g++ libgrpc++-dev protobuf-compiler-grpc": "needs root; the gate does it where it can",
}


class Page:
    """A reader who follows a page."""

    def __init__(self, folder):
        self.folder = folder
        program = Path(os.environ.get("COVIS_BIN") or shutil.which("covis")).absolute()
        # Under its own name, whatever the binary is called.
        (folder / ".bin").mkdir()
        (folder / ".bin" / "covis").symlink_to(program)
        (folder / "covis").symlink_to(ROOT)
        for part in ("tests", "python", "examples"):
            (folder / part).symlink_to(ROOT / part)
        self.server = None
        self.url = URL
        self.environment = {k: v for k, v in os.environ.items() if not k.startswith("COVIS_")}
        self.environment["PATH"] = f"{folder / '.bin'}:{os.environ['PATH']}"
        # The program of the page stays built from one run of the tests to the next.
        self.environment |= {
            "CARGO_NET_OFFLINE": "true", "CARGO_TARGET_DIR": str(ROOT / "target" / "tutorial"),
            "CARGO_PROFILE_DEV_DEBUG": "0",
            # A new environment finds what the package depends on.
            "PYTHONPATH": sysconfig.get_path("purelib"),
        }  # fmt: skip

    def lend(self):
        """The environment of Python that the tests have."""
        (self.folder / "venv").symlink_to(sys.prefix)

    def set_up(self, commands):
        """Runs what can be run without the network: pip finds what the tests' environment has."""
        known = [line for line in commands.splitlines() if line not in NOT_RUN]
        packages = {
            "PIP_NO_INDEX": "1", "PIP_NO_BUILD_ISOLATION": "0", "PIP_DISABLE_PIP_VERSION_CHECK": "1",
        }  # fmt: skip
        return self.run("\n".join(known), packages)

    def serve(self, command):
        """Starts the server on a free port; all that follows means this one."""
        self.stop()
        listens = self.environment | {"COVIS_LISTEN": "127.0.0.1:0"}
        has_page = PAGE in command
        command = re.sub(r"--listen \S+", "--listen 127.0.0.1:0", command.replace(PAGE, "127.0.0.1:0"))
        log = open(self.folder / "server.log", "wb")
        self.server = subprocess.Popen(
            ["bash", "-c", f"exec {command}"], cwd=self.folder, env=listens, stdout=subprocess.PIPE,
            stderr=log, text=True,
        )  # fmt: skip
        first = self.server.stdout.readline()
        assert first.startswith("listening on "), (self.folder / "server.log").read_text()
        self.url = first.split()[-1]
        self.environment["COVIS_SERVER"] = self.url
        printed = first.replace(self.url, URL) + self.server.stdout.readline()
        if has_page:
            printed += re.sub(r"127\.0\.0\.1:\d+", PAGE, self.server.stdout.readline())
        return printed

    def run(self, commands, more=None):
        commands = PROGRAM.sub(lambda it: f"{it[0]}{' --' if it[0] == 'cargo run' else ''} {URL}", commands)
        commands = SECURE.sub(self.url, commands.replace(URL, self.url))
        done = subprocess.run(
            ["bash", "-euo", "pipefail", "-c", commands], cwd=self.folder,
            env=self.environment | (more or {}), stdin=subprocess.DEVNULL, capture_output=True, text=True,
            timeout=10 * GUARD_S,
        )  # fmt: skip
        assert done.returncode == 0, f"{commands}\n{done.stdout}\n{done.stderr}"
        return done.stdout

    def stop(self):
        if self.server is not None:
            self.server.terminate()
            self.server.wait(GUARD_S)
            self.server.stdout.close()
            self.server = None


@pytest.fixture
def page(tmp_path):
    reader = Page(tmp_path)
    yield reader
    reader.stop()


def squeezed(text):
    """Without the widths of columns."""
    return [" ".join(line.split()) for line in text.splitlines() if line.strip()]


def source(name):
    """The text of a page."""
    return (ROOT / ("README.md" if name == "README" else f"docs/{name}.md")).read_text()


def follow(page, name, with_cpp=False):
    """Does what the page says; answers how many blocks of commands were run."""
    printed, count = "", 0
    text = source(name)
    if "-m venv venv" not in text:
        page.lend()
    for kind, text in BLOCK.findall(text):
        if kind == "sh,server":
            printed = page.serve(text.strip())
        elif kind == "sh,run":
            printed = page.run(text)
        elif kind == "sh,setup":
            printed = page.set_up(text)
        elif kind == "sh,cpp":
            printed = page.run(text) if with_cpp else None
        elif kind == "console":
            continue
        elif re.match(r"(python|cmake|toml),file=", kind):
            path = page.folder / kind.split("=")[1]
            path.parent.mkdir(exist_ok=True)
            path.write_text(text.replace(URL, page.url))
        elif kind == "text,output":
            for line in squeezed(text):
                assert printed is None or any(line in found for found in squeezed(printed)), (line, printed)
        else:
            raise AssertionError(f"```{kind} says not whether it is run")
        count += kind.startswith("sh,")
    return count


@pytest.mark.parametrize("name", PAGES)
def test_a_reader_who_follows_a_page_word_for_word_gets_there(page, name):
    assert follow(page, name) >= 3


def test_what_is_not_run_is_on_a_page():
    lines = {line for name in PAGES for line in source(name).splitlines()}
    assert [command for command in NOT_RUN if command not in lines] == []
