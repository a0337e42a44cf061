"""A USB bus for librealsense without any hardware: its own pipelines play a file wherever a device would be started.

Only what needs USB is replaced (the device list, the choice of a device, the hardware reset); frames, alignment, sensor
options and recording are librealsense's.
"""

import shutil
import time
from dataclasses import dataclass, field
from pathlib import Path

import pyrealsense2 as rs

OPTIONS = {
    "visual_preset": (0, 6, 1, 0),
    "depth_units": (0.0001, 0.01, 0.0001, 0.001),
    "enable_auto_exposure": (0, 1, 1, 1),
    "exposure": (1, 165000, 1, 8500),
    "gain": (16, 248, 1, 16),
    "emitter_enabled": (0, 2, 1, 1),
    "laser_power": (0, 360, 30, 150),
    "global_time_enabled": (0, 1, 1, 0),
}
"""Range of each option of a D435i's depth sensor: least, most, step, default."""


def depth_sensor(*missing: str) -> tuple[rs.software_device, rs.software_sensor]:
    """A software sensor with a D435i's options, without those named."""
    device = rs.software_device()
    sensor = device.add_sensor("Stereo Module")
    for name, (low, high, step, default) in OPTIONS.items():
        if name not in missing:
            bounds = rs.option_range()
            bounds.min, bounds.max, bounds.step, bounds.default = low, high, step, default
            sensor.add_option(getattr(rs.option, name), bounds, True)
    return device, sensor


FIRMWARE = "5.16.0.1"
"""What every stand-in says is installed."""


@dataclass
class Plugged:
    """One camera on the bus."""

    bus: "Bus"
    serial: str
    usb: str = "3.2"

    def supports(self, key):
        return key in self._known()

    def get_info(self, key):
        return self._known()[key]

    def _known(self):
        fields = rs.camera_info
        said = {fields.name: "Intel RealSense D435I", fields.firmware_version: FIRMWARE}
        return said | {fields.serial_number: self.serial, fields.usb_type_descriptor: self.usb}

    def hardware_reset(self):
        self.bus.resets.append(self.serial)
        if self.bus.gone_after_reset:
            self.bus.cameras.remove(self)

    def first_depth_sensor(self):
        return self.bus.sensor[1]


@dataclass
class Bus:
    """Cameras that are plugged in, and what each start of a stream will play.

    Attributes:
        files: played one after the other, the last one for ever; an exception is raised instead.
        started: serial number, streams and file of each start.
        resets: serial numbers that were reset.
        refuse: what librealsense says when it refuses the streams.
        hang_s: how long a pipeline hangs when it is stopped [s].
    """

    files: list[Path | Exception]
    cameras: list[Plugged] = field(default_factory=list)
    gone_after_reset: bool = False
    started: list[tuple[str, tuple, Path]] = field(default_factory=list)
    resets: list[str] = field(default_factory=list)
    sensor: tuple = field(default_factory=depth_sensor)
    refuse: str = ""
    hang_s: float = 0.0

    def plug(self, *serials: str, usb: str = "3.2") -> "Bus":
        self.cameras += [Plugged(self, serial, usb) for serial in serials]
        return self

    def __getattr__(self, name):
        return getattr(rs, name)

    def context(self):
        return self

    def query_devices(self):
        return list(self.cameras)

    def config(self):
        return Setup(self)

    def pipeline(self):
        return Pipeline(self)

    def pipeline_wrapper(self, pipeline):
        return pipeline


@dataclass
class Setup:
    """Stands in for `rs.config`."""

    bus: Bus
    serial: str = ""
    streams: tuple = ()
    record_to: str = ""

    def enable_device(self, serial):
        self.serial = serial

    def enable_stream(self, *stream):
        self.streams += (stream,)

    def enable_record_to_file(self, path):
        self.record_to = path

    def resolve(self, pipeline):
        if self.bus.refuse:
            raise RuntimeError(self.bus.refuse)
        return self

    def get_device(self):
        return next(camera for camera in self.bus.cameras if camera.serial == self.serial)


class Profile:
    """The profile of a played file, whose device is the plugged one."""

    def __init__(self, real, camera):
        self._real, self._camera = real, camera

    def __getattr__(self, name):
        return getattr(self._real, name)

    def get_device(self):
        real, camera = self._real.get_device(), self._camera

        class Device:
            supports, get_info = camera.supports, camera.get_info
            first_depth_sensor = real.first_depth_sensor

        return Device()


class Pipeline:
    """librealsense's pipeline, playing in real time and repeating."""

    def __init__(self, bus):
        self._bus, self._real = bus, rs.pipeline()
        self._file, self._record_to = None, ""

    def __getattr__(self, name):
        return getattr(self._real, name)

    def stop(self):
        time.sleep(self._bus.hang_s)
        self._real.stop()
        if self._record_to:
            shutil.copy(self._file, self._record_to)

    def start(self, setup):
        file = self._bus.files.pop(0) if len(self._bus.files) > 1 else self._bus.files[0]
        if isinstance(file, Exception):
            raise file
        self._file, self._record_to = file, setup.record_to
        self._bus.started.append((setup.serial, setup.streams, file))
        real = rs.config()
        real.enable_device_from_file(str(file), file.stem != "once")
        return Profile(self._real.start(real), setup.get_device())
