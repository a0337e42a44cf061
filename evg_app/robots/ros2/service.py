"""One call of one service, with a name and a timeout."""

import contextlib
import threading
from typing import Any

from evg_app.errors import HardwareError
from evg_app.robots.ros2.link import Link


class Service:
    """A client that exists for one call."""

    def __init__(self, link: Link, kind: Any, name: str) -> None:
        self._link, self._kind, self._name = link, kind, name

    def call(self, request: Any, timeout: float, advice: str) -> Any:
        """Call it and return the response.

        Raises:
            HardwareError: nobody serves it, or the call failed.
            DeviceTimeout: no answer in `timeout` [s].
        """
        link, answered = self._link, threading.Event()
        box: list[Any] = []
        client = link.call(lambda: link.node.create_client(self._kind, self._name), f"a client of {self._name}")

        def keep(future: Any) -> None:
            """Keep the response."""
            box.append(future)
            answered.set()

        def ask() -> None:
            """On the executor's thread: call it."""
            client.call_async(request).add_done_callback(keep)

        try:
            if not link.wait_until(client.service_is_ready, timeout):
                raise HardwareError(f"nobody serves {self._name}. {advice}")
            link.call(ask, f"the request to leave for {self._name}")
            link.wait(answered, timeout, f"{self._name} to answer", advice)
            return box[0].result()
        finally:
            with contextlib.suppress(HardwareError):
                link.call(lambda: link.node.destroy_client(client), f"leaving {self._name}")
