"""The hand process: owns the connection to the gripper. libfranka's gripper calls block, and block all of Python."""

import signal
import time
from multiprocessing.connection import Connection
from typing import Any

from evg_app.robots.fci.messages import Failed, Grip, Gripped, Leave


def main(pipe: Connection, host: str) -> None:
    """Entry of the process: connect, then carry out one `Grip` after the other."""
    for number in (signal.SIGINT, signal.SIGHUP):  # both reach the whole process group; the application decides
        signal.signal(number, signal.SIG_IGN)
    try:
        import pylibfranka
    except ImportError as error:
        pipe.send(Failed("ImportError", str(error)))
        return
    refusals = (RuntimeError, pylibfranka.FrankaException)
    try:
        gripper = pylibfranka.Gripper(host)
        pipe.send(_read(gripper, True))
    except refusals as error:
        pipe.send(Failed(type(error).__name__, str(error)))
        return
    try:
        while True:
            request = pipe.recv()
            if isinstance(request, Leave):
                return
            if isinstance(request, Grip):
                pipe.send(_carry_out(gripper, request, refusals))
    except (EOFError, BrokenPipeError, ConnectionResetError):
        return


def _carry_out(gripper: Any, request: Grip, refusals: tuple[type[Exception], ...]) -> Gripped | Failed:
    """One command; a command that the hand refuses is no success, a lost connection is `Failed`."""
    success, message = True, ""
    try:
        if request.command != "read":
            success = bool(getattr(gripper, request.command)(*request.arguments))
    except refusals as error:
        if type(error).__name__ == "NetworkException":
            return Failed("NetworkException", str(error))
        success, message = False, str(error)
    try:
        return _read(gripper, success, message)
    except refusals as error:
        return Failed(type(error).__name__, str(error))


def _read(gripper: Any, success: bool, message: str = "") -> Gripped:
    """The hand's state now, with the verdict of the command before it."""
    state = gripper.read_once()
    return Gripped(
        success,
        float(state.width),
        float(state.max_width),
        bool(state.is_grasped),
        time.monotonic(),
        message,
        int(gripper.server_version()),
    )
