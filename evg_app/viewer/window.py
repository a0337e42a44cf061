"""The browser window: a viser server with the 3D scene and the panel beside it."""

from types import TracebackType
from typing import Any, Self

import numpy as np

from evg_app.config.models import RobotConfig
from evg_app.errors import BadInput, MissingExtra
from evg_app.viewer import text
from evg_app.viewer.colors import Bytes
from evg_app.viewer.drawing import Drawing
from evg_app.viewer.gate import Gate
from evg_app.viewer.scene import LAYERS, Scene

DEFAULT_PORT = 8080
LOCAL = ("127.0.0.1", "localhost")
"""Hosts that need no token: only this machine reaches them."""
VERDICT, SCORE = "verdict", "score"
IMAGE_WIDTH = 320
"""Of the camera image in the panel, at most about twice this [px]."""
HIDDEN_FIRST = ("tsdf",)
"""Layers that are off until somebody wants them."""


class Window:
    """Serves the view until it is closed.

    Args:
        robot: whose arm is drawn.
        host, port: where browsers find it. Any host but this machine's own wants the token in `url`.

    Raises:
        MissingExtra: viser is not installed.
        BadInput: nobody can listen there, or the robot's meshes cannot be read.
    """

    def __init__(self, robot: RobotConfig, host: str = LOCAL[0], port: int = DEFAULT_PORT) -> None:
        viser = _viser()
        local = host in LOCAL
        self.server: Any = viser.ViserServer("127.0.0.1", port if local else 0, verbose=False)
        self._gate: Gate | None = None
        inner = int(self.server.get_port())
        try:
            if not local:
                self._gate = Gate(host, port, inner)
            elif port not in (0, inner):
                raise BadInput(f"port {port} is taken, by another viewer perhaps. Give another with --port")
            self.scene = Scene(self.server, robot)
        except BaseException:
            self.close()
            raise
        self.url = f"http://127.0.0.1:{inner}/"
        if self._gate is not None:
            self.url = f"http://{host}:{self._gate.port}/?token={self._gate.token}"
        self._panel()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Serve no more."""
        if self._gate is not None:
            self._gate.close()
        self.server.stop()

    def show(self, drawn: Drawing, words: list[str]) -> None:
        """Show a pass, with what there is to say about it."""
        self.scene.show(drawn, self._color_by.value == SCORE)
        self._says.content, self._legend.content = text.lines(words), text.legend(drawn.verdicts)
        if drawn.image is not None:
            self._image.image = _small(drawn.image)
        if len(drawn.path):
            self._along.value = round(drawn.grasp_at / max(len(drawn.path) - 1, 1), 3)

    def say(self, words: list[str]) -> None:
        """Only the text about the pass."""
        self._says.content = text.lines(words)

    def count(self, words: list[str]) -> None:
        """The run's counters."""
        self._counts.content = text.lines(words)

    @property
    def words(self) -> str:
        """What is written about the pass, as HTML."""
        return str(self._says.content)

    @property
    def counts(self) -> str:
        """What is written about the run, as HTML."""
        return str(self._counts.content)

    def _panel(self) -> None:
        """Everything beside the picture."""
        gui = self.server.gui
        gui.configure_theme(control_layout="fixed", show_logo=False, show_share_button=False)
        gui.set_panel_label("evg-app")
        self._counts = gui.add_html("", order=0)
        self._says = gui.add_html("", order=20)
        self._image = gui.add_image(np.zeros((3, 4, 3), np.uint8), label="camera", format="jpeg", order=30)
        self._along = gui.add_slider("along the path", min=0.0, max=1.0, step=0.001, initial_value=0.0, order=40)
        self._along.on_update(lambda _: self.scene.move_along(float(self._along.value)))
        self._color_by = gui.add_dropdown("candidates by", (VERDICT, SCORE), order=50)
        self._color_by.on_update(lambda _: self.scene.recolor(self._color_by.value == SCORE))
        self._legend = gui.add_html("", order=60)
        with gui.add_folder("show", order=70, expand_by_default=False):
            for layer in LAYERS:
                self._switch(layer)

    def _switch(self, layer: str) -> None:
        """A box that shows or hides a layer."""
        shown = layer not in HIDDEN_FIRST
        box = self.server.gui.add_checkbox(layer, shown)
        self.scene.switch(layer, shown)
        box.on_update(lambda _: self.scene.switch(layer, bool(box.value)))


def _viser() -> Any:
    """The library, without its greeting."""
    try:
        import rich
        import viser
    except ImportError as error:
        raise MissingExtra("viser", "viewer") from error
    rich.get_console().quiet = True  # viser talks through it past its own `verbose`
    return viser


def _small(image: Bytes) -> Bytes:
    """Every n-th pixel, so that it is about as wide as the panel."""
    step = max(image.shape[1] // IMAGE_WIDTH, 1)
    return np.ascontiguousarray(image[::step, ::step])
