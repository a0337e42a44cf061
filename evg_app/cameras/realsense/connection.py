"""Keeps a RealSense stream alive: named attempts, a hardware reset before the last, every wait bounded."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from evg_app.cameras.realsense.devices import USB_ADVICE, is_present, reset_device
from evg_app.cameras.realsense.link import Link, Shot
from evg_app.cameras.realsense.sdk import load_sdk
from evg_app.cameras.realsense.start import Recording, StartFailed
from evg_app.clock import Clock
from evg_app.config.camera import CameraConfig
from evg_app.errors import DeviceTimeout, HardwareError

Report = Callable[[str, str], None]
"""Told what the camera is going through: a short machine-readable cause, and a sentence."""

FIRST_FRAME = 3.0
"""How long a started stream may take to its first frame [s]; a D435i takes about one."""
POLL = 0.2
"""How often the camera is looked for after a hardware reset [s]."""
RECORDING_ADVICE = "Name a longer recording, or make one: evg-app camera record"


class Connection:
    """The way to one camera or recording. Nothing happens before `open`.

    Args:
        config: what is asked of the camera.
        clock: of the stamps and waits.
        report: told about every retry.
        serial: which camera; "" takes the config's, and if that is empty the only one.
        recording: play this file instead.
        record_to: also write the streams to this .db3 file.
        sdk: the module `pyrealsense2`; imported when None.
    """

    def __init__(
        self,
        config: CameraConfig,
        clock: Clock,
        report: Report,
        serial: str,
        recording: Recording | None,
        record_to: Path | None,
        sdk: Any,
    ) -> None:
        self._config, self._clock, self._report = config, clock, report
        self._serial = serial or config.realsense.serial
        self._recording, self._record_to, self._sdk = recording, record_to, sdk
        self._running = False
        self._link: Link | None = None
        self._held: Shot | None = None

    @property
    def link(self) -> Link:
        """The running stream, or the last one that ran.

        Raises:
            HardwareError: there never was one.
        """
        if self._link is None:
            raise HardwareError(f"camera '{self._config.name}' is not open: use it in a `with` block")
        return self._link

    def close(self) -> None:
        """Stop the stream; may be called at any time, repeatedly."""
        self._running, self._held = False, None
        if self._link is not None:
            self._link.stop()

    def open(self) -> None:
        """Start the stream, unless it runs: at most `attempts` starts of `FIRST_FRAME`, one reset, one warm-up.

        Raises:
            HardwareError: no such camera, or no frame in all attempts.
            DeviceTimeout: it did not come back from its reset.
            BadInput: a setting or a recording that cannot be used.
        """
        if self._running:
            return
        self._sdk = self._sdk or load_sdk()
        attempts, problem = self._config.realsense.attempts, ""
        for attempt in range(1, attempts + 1):
            if attempt == attempts and attempt > 1 and self._recording is None:
                self._reset()
            try:
                problem = self._start()
            except BaseException:
                self.close()
                raise
            if not problem:
                self._running = True
                return
            self.close()
            self._report("camera start", f"{self._label()}, attempt {attempt} of {attempts}: {problem}")
        raise HardwareError(
            f"{self._label()} gave no frame in {attempts} attempts; the last: {problem} {self._advice()}"
        )

    def fresh(self, after: float, deadline: float, timeout: float) -> Shot:
        """The first shot exposed at or after `after` [s], starting the stream again when it died.

        A stream is dead when nothing new came for `stall_s`. `deadline` [s] ends the wait; `timeout` is for the words.

        Raises:
            DeviceTimeout: none came.
            HardwareError: the camera left USB, the recording has ended, or the stream cannot be started.
        """
        self.open()
        stall, silent_since = self._config.realsense.stall_s, self._clock.now()
        while (left := deadline - self._clock.now()) > 0:
            held, self._held = self._held, None
            shot = held or self.link.next(min(left, stall))
            if shot is not None:
                silent_since = self._clock.now()
                if shot.stamp >= after:
                    return shot
            elif self.link.ended or self._clock.now() - silent_since >= stall:
                self._restart(stall)
                silent_since = self._clock.now()
        raise DeviceTimeout(f"a fresh frame of {self._label()}", timeout, self._advice())

    def _restart(self, stall: float) -> None:
        """Nothing came for `stall` seconds: say why nothing can, or start again."""
        reason = self.link.lost()
        self.close()
        if reason:
            raise HardwareError(f"{reason}. {USB_ADVICE if self._recording is None else RECORDING_ADVICE}")
        self._report("camera stall", f"{self._label()}: no frame for {stall:g} s; starting the stream again")
        self.open()

    def _start(self) -> str:
        """Start and warm up. Returns what went wrong, "" when frames come."""
        try:
            link = Link(self._sdk, self._config, self._clock, self._recording, self._serial, self._record_to)
        except StartFailed as error:
            return str(error)
        self._link = link
        if self._recording is None:
            self._serial = link.info.serial
        first = link.next(FIRST_FRAME)
        if first is None:
            return f"no frame within {FIRST_FRAME:g} s of the start."
        if self._recording is not None:
            self._held = first
            return ""
        settled = self._clock.now() + self._config.realsense.warmup_s
        while self._clock.now() < settled:
            link.next(POLL)
        return ""

    def _reset(self) -> None:
        """Hardware reset, then wait until the camera is back on USB."""
        self._report("camera reset", f"{self._label()}: hardware reset over USB before the last attempt")
        reset_device(self._sdk, self._serial)
        timeout = self._config.realsense.reset_timeout_s
        deadline = self._clock.now() + timeout
        self._clock.sleep(POLL)
        while not is_present(self._sdk, self._serial):
            if self._clock.now() > deadline:
                raise DeviceTimeout(f"{self._label()} to come back from its reset", timeout, USB_ADVICE)
            self._clock.sleep(POLL)

    def _label(self) -> str:
        """How messages call it."""
        if self._recording is not None:
            return f"recording {self._recording.path}"
        return f"camera '{self._config.name}'" + (f" ({self._serial})" if self._serial else "")

    def _advice(self) -> str:
        """What to do when no frame comes."""
        slow = "" if self._recording is not None or self._link is None else self._link.info.link_advice()
        return slow or "Run: evg-app doctor --camera"
