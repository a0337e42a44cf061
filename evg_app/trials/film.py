"""A small GIF of a run, in bounded memory and of bounded size."""

import io
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from evg_app.trials.arrays import write_atomically


class Film:
    """Keeps every n-th image that is offered; n doubles whenever `max_frames` are held.

    Args:
        width: of the film [px]; the height follows the first image.
        max_frames: at most this many are kept.
        max_bytes: of the file; frames are dropped until it fits.
        frame_ms: how long a frame is shown [ms].
        colors: size of the palette.
    """

    def __init__(
        self,
        width: int = 320,
        max_frames: int = 160,
        max_bytes: int = 4_500_000,
        frame_ms: int = 100,
        colors: int = 64,
    ) -> None:
        self._width, self._max_frames, self._max_bytes = width, max_frames, max_bytes
        self._frame_ms, self._colors = frame_ms, colors
        self._frames: list[Image.Image] = []
        self._size: tuple[int, int] | None = None
        self._offered, self._stride = 0, 1

    def __len__(self) -> int:
        """Number of frames held."""
        return len(self._frames)

    def add(self, image: NDArray[np.uint8]) -> None:
        """Offer an image. uint8 RGB, shape (H, W, 3), any size."""
        wanted = self._offered % self._stride == 0
        self._offered += 1
        if not wanted:
            return
        if self._size is None:
            self._size = self._width, max(1, round(self._width * image.shape[0] / image.shape[1]))
        self._frames.append(Image.fromarray(image).resize(self._size, Image.Resampling.BILINEAR))
        if len(self._frames) >= self._max_frames:
            self._frames = self._frames[::2]
            self._stride *= 2

    def save(self, path: Path) -> int:
        """Write the GIF; its size in bytes, 0 when there was nothing to show.

        Raises:
            OSError: it cannot be written.
        """
        frames, shown_ms = self._frames, self._frame_ms
        while frames:
            data = self._encode(frames, shown_ms)
            if len(data) <= self._max_bytes or len(frames) <= 2:
                write_atomically(path, data)
                return len(data)
            frames, shown_ms = frames[::2], min(shown_ms * 2, 400)
        return 0

    def _encode(self, frames: list[Image.Image], shown_ms: int) -> bytes:
        """The frames as the bytes of a GIF."""
        palette = _palette(frames, self._colors)
        small = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
        buffer = io.BytesIO()
        small[0].save(
            buffer, format="GIF", save_all=True, append_images=small[1:], duration=shown_ms, loop=0, optimize=True
        )
        return buffer.getvalue()


def _palette(frames: list[Image.Image], colors: int) -> Image.Image:
    """One palette for the whole film, from a few of its frames side by side."""
    few = [frames[i] for i in sorted({0, len(frames) // 3, 2 * len(frames) // 3, len(frames) - 1})]
    width, height = few[0].size
    sheet = Image.new("RGB", (width * len(few), height))
    for i, frame in enumerate(few):
        sheet.paste(frame, (i * width, 0))
    return sheet.quantize(colors=colors, method=Image.Quantize.MEDIANCUT)
