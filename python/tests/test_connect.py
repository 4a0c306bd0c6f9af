"""How a program reaches a server: addresses, tokens, a server of its own."""

import gc
import hashlib
import os
import shutil
import signal
import subprocess
import sys
import warnings

import covis
import pytest
from conftest import Server
from covis import _loop


@pytest.mark.parametrize("url", ["nonsense", "ftp://a:1", "http://", "http://a:port", "http://a:1/path"])
def test_what_is_no_url_is_refused(url):
    with pytest.raises(covis.InvalidUrl, match="is not the URL of a server"):
        covis.connect(url)


def test_nobody_at_the_address_is_a_clear_error(server):
    server.kill()
    with pytest.raises(covis.Unreachable, match=f"no server answers at {server.url}: .*refused"):
        covis.connect(server.url)
    server.start()


TOKEN = "a-token-that-is-long-enough-for-a-robot"


@pytest.fixture
def guarded(tmp_path):
    digest = hashlib.sha256(TOKEN.encode()).hexdigest()
    tokens = f'[[token]]\nname = "robot"\nsha256 = "{digest}"\nrole = "write"\n'
    (tmp_path / "tokens.toml").write_text(tokens)
    running = Server(tmp_path, "--tokens", str(tmp_path / "tokens.toml"))
    yield running
    running.stop()


def test_a_certificate_is_checked_against_the_authority_that_is_named(tmp_path):
    openssl = shutil.which("openssl")
    if openssl is None:
        pytest.skip("no openssl")
    command = [openssl, "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes",
               "-keyout", "key.pem", "-out", "cert.pem", "-days", "2", "-subj", "/CN=covis test",
               "-addext", "subjectAltName=IP:127.0.0.1"]  # fmt: skip
    subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)
    files = ["--tls-cert", str(tmp_path / "cert.pem"), "--tls-key", str(tmp_path / "key.pem")]
    server = Server(tmp_path, *files)
    assert server.url.startswith("https://")
    with covis.connect(server.url, ca=tmp_path / "cert.pem", token=TOKEN) as client:
        client.create_map("room")
        with client.ingest("room", "robot") as session:
            session.camera(0, 640, 480, [[500, 0, 320], [0, 500, 240], [0, 0, 1]])
    with pytest.raises(covis.Unreachable, match="(?i)certificate"):
        covis.connect(server.url)
    server.stop()


def test_a_token_is_an_argument_a_file_or_a_variable(guarded, tmp_path, monkeypatch):
    with covis.connect(guarded.url) as client, pytest.raises(covis.Unauthenticated):
        client.list_maps()
    with covis.connect(guarded.url, token="another") as client:
        with pytest.raises(covis.Unauthenticated):
            client.ingest("room", "robot")
    with covis.connect(guarded.url, token=TOKEN) as client:
        client.create_map("room")
        with pytest.raises(covis.PermissionDenied) as denied:
            client.delete_map("room")
        assert denied.value.metadata["role"] == "admin"
        with client.ingest("room", "robot") as session, client.watch("room") as watched:
            assert session.opened.epoch == 1 and watched.revision >= 1
    (tmp_path / "robot.token").write_text(TOKEN + "\n")
    with covis.connect(guarded.url, token_file=tmp_path / "robot.token") as client:
        assert len(client.list_maps()) == 1
    monkeypatch.setenv("COVIS_TOKEN", TOKEN)
    with covis.connect(guarded.url) as client:
        assert len(client.list_maps()) == 1
    monkeypatch.setenv("COVIS_TOKEN_FILE", str(tmp_path / "robot.token"))
    monkeypatch.setenv("COVIS_TOKEN", "wrong")
    with covis.connect(guarded.url) as client:
        assert len(client.list_maps()) == 1


def test_a_token_is_never_shown_nor_sent_in_plain_text_to_another_machine():
    with pytest.raises(covis.TokenInPlainText) as refused:
        covis.connect("http://robot.example:1", token="secret")
    assert "secret" not in str(refused.value)
    for token in ("", " \n", "two\nlines", "ünicode"):
        with pytest.raises(covis.InvalidToken):
            covis.connect("https://robot.example:1", token=token)
    with pytest.raises(ValueError, match="cert and key belong together"):
        covis.connect("https://robot.example:1", cert="x")


def test_a_server_of_ones_own_ends_with_its_client_and_keeps_what_it_is_told_to(tmp_path, monkeypatch):
    # Neither variables nor a configuration file of whoever starts it count.
    monkeypatch.setenv("COVIS_LISTEN", "203.0.113.1:1")
    (tmp_path / "covis.toml").write_text("nonsense")
    monkeypatch.chdir(tmp_path)
    with covis.local(tmp_path / "kept") as client:
        client.create_map("room")
        url = client.url
    with pytest.raises(covis.Unreachable):
        covis.connect(url)
    with covis.local(tmp_path / "kept") as client:
        assert [found.map_id for found in client.list_maps()] == ["room"]


def test_a_server_that_does_not_start_says_why(tmp_path, monkeypatch):
    with pytest.raises(covis.ServerFailed, match="unexpected argument '--nonsense'"):
        covis.local(arguments=["--nonsense"])
    with pytest.raises(covis.ServerFailed, match="cannot start .*missing"):
        covis.local(binary=str(tmp_path / "missing"))
    monkeypatch.delenv("COVIS_BIN", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(covis.ServerFailed, match="COVIS_BIN is not set"):
        covis.local()


PROGRAM = """
import os, signal, sys, threading, covis
# Whatever runs the tests in the background may have interrupts ignored, which is inherited.
signal.signal(signal.SIGINT, signal.default_int_handler)
client = covis.local()
session = client.ingest("room", "robot")
watched = client.watch("room")
def is_waiting():
    frame = sys._current_frames()[threading.main_thread().ident]
    names = [frame.f_code.co_name]
    while frame := frame.f_back:
        names.append(frame.f_code.co_name)
    return names[:2] == ["wait", "result"]
def interrupt():
    while not is_waiting():
        os.sched_yield()
    signal.pthread_kill(threading.get_ident(), signal.SIGINT)
if sys.argv[1] == "is interrupted in another thread":
    threading.Thread(target=interrupt).start()
print(client._twin._server._process.pid, flush=True)
if sys.argv[1] != "ends":
    session.wait_optimized()
    watched.wait(10**9)
"""


def test_an_interrupt_before_a_call_has_begun_leaves_nothing_that_is_never_awaited(server, monkeypatch):
    def interrupted():
        raise KeyboardInterrupt

    with covis.connect(server.url) as client, warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        with monkeypatch.context() as patched:
            patched.setattr(_loop, "_running", interrupted)
            with pytest.raises(KeyboardInterrupt):
                client.list_maps()
        gc.collect()
        assert client.list_maps() == []
    assert [str(warning.message) for warning in found if "awaited" in str(warning.message)] == []


@pytest.mark.parametrize("how", ["ends", "waits", "is interrupted in another thread"])
def test_a_program_that_closes_nothing_still_ends_and_its_server_with_it(how):
    command = [sys.executable, "-c", PROGRAM, how]
    child = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    server = int(child.stdout.readline())
    if how == "waits":
        child.send_signal(signal.SIGINT)
    _, said = child.communicate(timeout=30)
    assert said == "" if how == "ends" else "KeyboardInterrupt" in said
    assert "never awaited" not in said and "Task was destroyed" not in said
    with pytest.raises(ProcessLookupError):
        os.kill(server, 0)
