"""The page of `kitchen-view` runs no code that a browser names, and shows texts of others without markup."""

import contextlib
import html
import random
import re
import subprocess
import sys
import threading

import pytest
from helpers.viser_client import Browser

from kitchen_suite.viewer.escaping import escaped

pytestmark = pytest.mark.web

# Nothing else than letters, digits, harmless signs and character references.
_HARMLESS = re.compile(r"""(?:[^\W_]|[ .,;:'"/+=%?^]|&\#\d+;)*""")

TEXTS = (
    "<script>window.hit = 1</script>",
    "<img src=x onerror=window.hit=1>",
    "[click](javascript:window.hit=1) ![x](http://127.0.0.1:1/x.png)",
    "`code` **bold** __bold__ ~~gone~~ # head | cell | {1 + 1} $x$ \\* &lt;b&gt;",
    "http://evil.com www.evil.com me@evil.com https://evil.com",
    "line\n\n# heading\r\n- item\n1. item\n| a |\n|---|\n```\ncode",
    "\x1b[31m\x00\u202egnp.exe\ud800",
)


def test_no_text_of_others_is_markup():
    generator = random.Random(0)
    odd = ("".join(chr(generator.randrange(0x2FFF)) for _ in range(200)) for _ in range(200))
    for text in (*TEXTS, *odd):
        shown = escaped(text)
        assert _HARMLESS.fullmatch(shown), shown
        for mark in ("://", "www.", "@"):
            assert mark not in html.unescape(shown).replace("\u200b" + mark[-1:], "")


def test_a_plain_text_stays_as_it_is():
    text = "policy 'moon' does not exist; choose from expert, random"
    assert escaped(text) == text
    assert html.unescape(escaped("a_b [c] <d> {e} - f")) == "a_b [c] <d> {e} - f"


@contextlib.contextmanager
def viewing(port, *flags, **popen):
    command = [sys.executable, "-m", "kitchen_suite", "view", "--domain_name=microwave_table", f"--port={port}", *flags]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, **pipes, **popen) as running:
        try:
            yield running, running.stdout.readline().split()[0]
        finally:
            running.kill()


def test_a_page_imports_and_calls_nothing_that_a_browser_names(port, tmp_path):
    """Domain, task and policy get a module to be imported, whose import would leave a file, and an address."""
    (tmp_path / "planted.py").write_text("open('imported', 'w').close()\n", encoding="utf-8")
    with viewing(port, "--policy=zero", "--no_token", cwd=tmp_path), contextlib.closing(Browser(port)) as browser:
        browser.wait(lambda: "Load" in browser.widgets and "control step" in browser.report())
        for label, offered in {"Policy": "zero", "Task": "open", "Domain": "microwave_table"}.items():
            for value in ("planted:ACT", "gym:planted:ACT", f"ws://127.0.0.1:{port}"):
                browser.set(label, value)
                browser.click("Load")
                start = f"{label.lower()} '{value.partition(':')[0]}"
                browser.wait(lambda start=start: start in browser.report())
                assert "does not exist" in browser.report()
            browser.set(label, offered)
    assert not (tmp_path / "imported").exists()


def test_only_who_knows_the_address_is_talked_to(port):
    from websockets.exceptions import ConnectionClosed

    with viewing(port, "--policy=zero") as (_, address):
        token = address.rpartition("/")[2]
        assert len(token) >= 32
        for wrong in ("", token[:-1], token + "0", "x" * len(token), "%00"):
            with pytest.raises(ConnectionClosed), contextlib.closing(Browser(port, wrong)) as browser:
                browser.read(60.0)
        with contextlib.closing(Browser(port, token)) as browser:
            browser.wait(lambda: "control step" in browser.report())


def refusing_server():
    """A policy server whose answers report an error in HTML; the address, and a function that stops it."""
    import msgpack
    from websockets.sync.server import serve

    def handle(connection):
        connection.send(msgpack.packb({}))
        with contextlib.suppress(Exception):
            for _ in connection:
                connection.send(
                    "<b class=hit>raw</b> **bold** <img src=x onerror=window.hit=1><script>window.hit=1</script>"
                )

    server = serve(handle, "127.0.0.1", 0)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    return f"ws://127.0.0.1:{server.socket.getsockname()[1]}", server.shutdown


def test_the_error_of_a_policy_server_is_shown_as_text(port):
    policy, stop = refusing_server()
    with viewing(port, f"--policy={policy}", "--no_token"), contextlib.closing(Browser(port)) as browser:
        browser.wait(lambda: "**Error:**" in browser.report())
        report = browser.report()
        assert "&#60;script&#62;window.hit=1" in report
        assert "<" not in report
    stop()


@pytest.mark.browser
def test_no_script_of_a_policy_server_runs(port):
    from helpers import pages

    policy, stop = refusing_server()
    with viewing(port, f"--policy={policy}") as (_, address), pages.opened(address) as (page, _):
        page.get_by_text("raw").first.wait_for()
        page.wait_for_timeout(1_000)
        assert page.evaluate("window.hit") is None
        assert page.locator(".hit").count() == 0
        assert "<b class=hit>raw</b> **bold** <img src=x onerror=window.hit=1><script>" in page.inner_text("body")
    stop()
