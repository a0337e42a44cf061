"""pyrealsense2 is imported late: evg-app runs without it until somebody asks for this camera."""

from typing import Any

from evg_app.errors import MissingExtra


def load_sdk() -> Any:
    """The module `pyrealsense2`.

    Raises:
        MissingExtra: it is not installed, or libusb is missing.
    """
    try:
        import pyrealsense2
    except ImportError as error:
        raise MissingExtra("pyrealsense2", "realsense") from error
    return pyrealsense2
