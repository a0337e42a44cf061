"""A door in front of the viewer for other machines: nobody passes who does not bring the token."""

import asyncio
import secrets
import threading
from http.cookies import CookieError, SimpleCookie
from urllib.parse import parse_qs, urlsplit

from evg_app.errors import BadInput

MAX_HEAD = 32 * 1024
"""Longest request head that is read [bytes]."""
PATIENCE = 10.0
"""How long a request head may take [s]."""
BLOCK = 64 * 1024


def token_of(head: bytes, cookie: str) -> tuple[str, str]:
    """The token in the URL and the one in the cookie of a request head; empty where there is none."""
    lines = head.decode("latin-1").split("\r\n")
    words = lines[0].split(" ")
    asked = parse_qs(urlsplit(words[1]).query).get("token", [""])[0] if len(words) == 3 else ""
    kept = ""
    for line in lines[1:]:
        name, _, value = line.partition(":")
        if name.strip().lower() == "cookie":
            try:
                jar = SimpleCookie(value.strip())
            except CookieError:
                continue
            kept = jar[cookie].value if cookie in jar else kept
    return asked, kept


class Gate:
    """Listens on host:port and hands connections on to a server of this machine, if they bring the token.

    The token comes in the URL (`?token=...`), once: it is then kept in a cookie, which the page's web socket brings.
    The text is not encrypted: use it in a network that you trust, or through an SSH tunnel.

    Args:
        host, port: where it listens; port 0 takes a free one.
        inner: port of the server on 127.0.0.1.

    Raises:
        BadInput: nobody can listen there.
    """

    def __init__(self, host: str, port: int, inner: int) -> None:
        self.token = secrets.token_urlsafe(18)
        self.host, self._inner = host, inner
        self._loop = asyncio.new_event_loop()
        try:
            self._server = self._loop.run_until_complete(asyncio.start_server(self._serve, host, port, limit=MAX_HEAD))
        except OSError as error:
            self._loop.close()
            raise BadInput(f"--host {host} --port {port} cannot be listened on: {error}. Name another") from error
        self.port = int(self._server.sockets[0].getsockname()[1])
        self._cookie = f"evg_view_{self.port}"
        self._thread = threading.Thread(target=self._loop.run_forever, name="viewer gate", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Listen no more, and drop who is connected."""
        asyncio.run_coroutine_threadsafe(self._end(), self._loop).result(timeout=PATIENCE)
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    async def _end(self) -> None:
        """Listen no more and drop the connections."""
        self._server.close()
        others = [task for task in asyncio.all_tasks(self._loop) if task is not asyncio.current_task()]
        for task in others:
            task.cancel()
        await asyncio.gather(*others, return_exceptions=True)

    def _right(self, given: str) -> bool:
        """Whether this is the token; compared in constant time."""
        return secrets.compare_digest(given.encode(), self.token.encode())

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """One connection: look at its head, then hand it on or not."""
        try:
            head = await asyncio.wait_for(reader.readuntil(b"\r\n\r\n"), PATIENCE)
            asked, kept = token_of(head, self._cookie)
            if self._right(asked):
                writer.write(self._welcome())
            elif self._right(kept):
                await self._hand_on(head, reader, writer)
            else:
                writer.write(_answer("403 Forbidden", "", b"Open the address that evg-app printed, with its token.\n"))
            await writer.drain()
        except (OSError, TimeoutError, asyncio.IncompleteReadError, asyncio.LimitOverrunError):
            pass  # whoever is there went away, or is no browser
        finally:
            writer.close()

    def _welcome(self) -> bytes:
        """The answer to the right token: keep it in a cookie, and go to the page."""
        cookie = f"Set-Cookie: {self._cookie}={self.token}; HttpOnly; SameSite=Lax; Path=/\r\n"
        return _answer("303 See Other", f"{cookie}Location: /\r\n", b"")

    async def _hand_on(self, head: bytes, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Bytes both ways between browser and viewer, the head first."""
        inner_reader, inner_writer = await asyncio.open_connection("127.0.0.1", self._inner)
        try:
            inner_writer.write(head)
            await asyncio.gather(_pump(reader, inner_writer), _pump(inner_reader, writer))
        finally:
            inner_writer.close()


async def _pump(source: asyncio.StreamReader, sink: asyncio.StreamWriter) -> None:
    """Bytes from one to the other until the source ends."""
    while block := await source.read(BLOCK):
        sink.write(block)
        await sink.drain()
    if sink.can_write_eof():
        sink.write_eof()


def _answer(status: str, headers: str, body: bytes) -> bytes:
    """An HTTP answer that ends the connection."""
    fixed = (
        f"Content-Type: text/plain\r\nContent-Length: {len(body)}\r\nCache-Control: no-store\r\nConnection: close\r\n"
    )
    return f"HTTP/1.1 {status}\r\n{fixed}{headers}\r\n".encode("latin-1") + body
