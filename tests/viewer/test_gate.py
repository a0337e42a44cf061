"""Nobody comes in from another machine without the token; with it everything passes, both ways."""

import http.client
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest

from evg_app.errors import BadInput
from evg_app.viewer.gate import Gate, token_of

TIMEOUT = 10
PAGE = b"the page" * 50_000


class Page(BaseHTTPRequestHandler):
    def do_GET(self):
        self.send_response(200)
        self.end_headers()
        self.wfile.write(PAGE)

    def log_message(self, *_words):
        """Quiet."""


@pytest.fixture
def gate():
    inner = ThreadingHTTPServer(("127.0.0.1", 0), Page)
    threading.Thread(target=inner.serve_forever, daemon=True).start()
    gate = Gate("127.0.0.1", 0, inner.server_port)
    yield gate
    gate.close()
    inner.shutdown()
    inner.server_close()


def get(gate: Gate, path: str, cookie: str = "") -> tuple[int, dict[str, str], bytes]:
    connection = http.client.HTTPConnection("127.0.0.1", gate.port, timeout=TIMEOUT)
    connection.request("GET", path, headers={"Cookie": cookie} if cookie else {})
    answer = connection.getresponse()
    result = answer.status, dict(answer.getheaders()), answer.read()
    connection.close()
    return result


@pytest.mark.parametrize("path", ["/", "/?token=", "/?token=wrong", "/assets/index.js", "/?nothing"])
def test_without_the_token_there_is_nothing_to_see(gate, path):
    status, _, body = get(gate, path)
    assert status == 403 and b"the page" not in body


def test_a_wrong_cookie_does_not_help(gate):
    assert get(gate, "/", f"evg_view_{gate.port}=wrong")[0] == 403


def test_the_token_is_kept_in_a_cookie_that_opens_every_page(gate):
    status, headers, _ = get(gate, f"/?token={gate.token}")
    assert status == 303 and headers["Location"] == "/", "the token does not stay in the address line"
    cookie = headers["Set-Cookie"]
    assert "HttpOnly" in cookie and "SameSite=Lax" in cookie
    status, _, body = get(gate, "/anything", cookie.split(";")[0])
    assert status == 200 and body == PAGE


def test_every_gate_has_its_own_token(gate):
    other = Gate("127.0.0.1", 0, 1)
    other.close()
    assert other.token != gate.token and len(gate.token) >= 20


def test_an_address_of_nobody_is_said():
    with pytest.raises(BadInput, match="--host"):
        Gate("203.0.113.77", 0, 1)


@pytest.mark.parametrize("head", [b"\r\n\r\n", b"GET\r\n\r\n", b"GET / HTTP/1.1\r\nCookie: =;;\xff\r\n\r\n"])
def test_nonsense_brings_no_token(head):
    assert token_of(head, "c") == ("", "")
