"""The live picture in a browser: a page on this machine alone that shows `live.jpg` anew several times a second."""

from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from types import TracebackType
from typing import Self

from evg_app.errors import BadInput
from evg_app.handeye.live import NAME

PAGE = b"""<!doctype html><meta charset=utf-8><title>calibration</title>
<style>body{background:#111;color:#ddd;font:15px system-ui;text-align:center}img{width:min(96vw,1280px)}</style>
<p>green: corners of a sample that is used; red: of one that is not; blue: where corners were so far</p>
<img id=live alt="waiting for the first picture"><script>
const live = document.getElementById("live");
const again = () => setTimeout(() => { live.src = "/live.jpg?" + Date.now(); }, 200);
live.onload = live.onerror = again; again();
</script>"""


class LivePage:
    """Serves a folder's live picture while inside.

    Args:
        folder: holds `live.jpg`, or will.
        port: 0 takes any free one.

    Raises:
        BadInput: the port is taken.
    """

    def __init__(self, folder: Path, port: int) -> None:
        """Take the port; nothing is served before it is entered."""
        try:
            self._server = ThreadingHTTPServer(("127.0.0.1", port), partial(_Handler, folder / NAME))
        except OSError as error:
            raise BadInput(f"port {port} cannot be used ({error.strerror}). Give another with --view-port") from error
        self._server.daemon_threads = True
        self.url = f"http://127.0.0.1:{self._server.server_address[1]}/"
        self._thread = Thread(target=self._server.serve_forever, args=(0.1,), name="live page", daemon=True)

    def __enter__(self) -> Self:
        """Begin to serve."""
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Serve no more."""
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()


class _Handler(BaseHTTPRequestHandler):
    """Answers with the page or the picture."""

    def __init__(self, picture: Path, *args: object) -> None:
        """Answer one request."""
        self._picture = picture
        super().__init__(*args)  # type: ignore[arg-type]

    def do_GET(self) -> None:
        """The page at /, the newest picture at /live.jpg."""
        if self.path == "/":
            self._send("text/html", PAGE)
        elif self.path.split("?")[0] == f"/{NAME}" and self._picture.exists():
            self._send("image/jpeg", self._picture.read_bytes())
        else:
            self.send_error(404)

    def _send(self, kind: str, body: bytes) -> None:
        """One whole answer."""
        self.send_response(200)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(body)))
        self.send_header("Cache-Control", "no-store")
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *args: object) -> None:
        """Say nothing."""
