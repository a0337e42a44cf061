"""A headless Chromium that is told what to do over its debugging protocol: what a person does with a mouse."""

import json
import shutil
import subprocess
import time
from base64 import b64decode
from itertools import count
from pathlib import Path

from websockets.sync.client import connect

PATIENCE = 150
"""For a browser without a GPU on a busy core to load the page, and again to draw it [s]."""
FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--remote-debugging-port=0",
)
PRESS = """(word => {
  const found = [...document.querySelectorAll('button, [role=button], label')]
    .filter(b => b.textContent.trim().startsWith(word) && !b.disabled && b.offsetParent !== null);
  if (found.length) found[0].click();
  return found.length;
})(%s)"""
FILL = """((label, words) => {
  const boxes = [...document.querySelectorAll('textarea, input')].filter(b => b.offsetParent !== null);
  const near = b => { let e = b; for (let i = 0; i < 5 && e; i++) { if (e.textContent.includes(label)) return true;
    e = e.parentElement; } return false; };
  const box = boxes.find(near);
  if (!box) return 0;
  Object.getOwnPropertyDescriptor(Object.getPrototypeOf(box), 'value').set.call(box, words);
  box.dispatchEvent(new Event('input', {bubbles: true}));
  return 1;
})(%s, %s)"""


def chromium() -> str:
    """The program."""
    found = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    assert found, "this test needs a browser: apt-get install chromium"
    return found


class Browser:
    """One tab."""

    def __init__(self, profile: Path, url: str, size: str = "800,600") -> None:
        words = [chromium(), *FLAGS, f"--window-size={size}", f"--user-data-dir={profile}", "about:blank"]
        self._process = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        self._numbers, port = count(1), profile / "DevToolsActivePort"
        self.until(port.is_file, "the browser to start")
        self.until(lambda: "\n" in port.read_text(), "the browser to name its port")
        number, path = port.read_text().split("\n")[:2]
        self._socket = connect(f"ws://127.0.0.1:{number}{path}", max_size=None, open_timeout=PATIENCE)
        target = self._call("Target.createTarget", {"url": url})["targetId"]
        self._session = ""
        self._session = self._call("Target.attachToTarget", {"targetId": target, "flatten": True})["sessionId"]
        self._call("Page.enable", {})

    def close(self) -> None:
        """End it."""
        self._socket.close()
        self._process.terminate()
        self._process.wait(timeout=30)

    def _call(self, method: str, params: dict) -> dict:
        message = {"id": next(self._numbers), "method": method, "params": params}
        if getattr(self, "_session", ""):
            message["sessionId"] = self._session
        self._socket.send(json.dumps(message))
        while True:
            answer = json.loads(self._socket.recv(timeout=PATIENCE))
            if answer.get("id") == message["id"]:
                assert "error" not in answer, answer
                return answer["result"]

    def evaluate(self, script: str):
        """The value of a piece of JavaScript."""
        answer = self._call("Runtime.evaluate", {"expression": script, "returnByValue": True, "awaitPromise": True})
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    def until(self, true, what: str):
        """What `true` returns as soon as it is something."""
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            found = true()
            if found:
                return found
            time.sleep(0.1)
        raise AssertionError(f"waited {PATIENCE} s for {what}; the page says: {self.text()[-600:]}")

    def text(self) -> str:
        """What the page says."""
        return str(self.evaluate("document.body ? document.body.innerText : ''"))

    def shows(self, words: str) -> None:
        """Wait for words on the page."""
        self.until(lambda: words in self.text(), f"'{words}'")

    def press(self, word: str) -> None:
        """Click the button that begins with this word, once it can be clicked."""
        self.until(lambda: self.evaluate(PRESS % json.dumps(word)), f"the button '{word}'")

    def fill(self, label: str, words: str) -> None:
        """Write into the field beside a label."""
        self.until(lambda: self.evaluate(FILL % (json.dumps(label), json.dumps(words))), f"the field '{label}'")

    def picture(self, path: Path) -> None:
        """Save what is seen."""
        path.write_bytes(self.shot())

    def shot(self) -> bytes:
        """What is seen, as PNG."""
        return b64decode(self._call("Page.captureScreenshot", {"format": "png"})["data"])

    def open(self, url: str) -> None:
        """Go to another address."""
        self._call("Page.navigate", {"url": url})
