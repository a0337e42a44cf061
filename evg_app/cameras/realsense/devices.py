"""Which RealSense cameras are connected, and which of them is meant."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from evg_app.errors import BadInput, HardwareError

USB_DEVICES = Path("/sys/bus/usb/devices")
"""Where Linux lists what is on USB."""
VENDOR = "8086"
PRODUCTS = {
    "0ad1": "D400",
    "0ad2": "D410",
    "0ad3": "D415",
    "0ad4": "D430",
    "0ad6": "D4xx on USB 2",
    "0b07": "D435",
    "0b3a": "D435i",
    "0b5b": "D405",
    "0b5c": "D455",
    "0adb": "D4xx in recovery mode",
    "0adc": "D4xx in recovery mode on USB 2",
}
"""USB product ids of the D400 family."""
USB_ADVICE = "Plug it into a USB 3 port, look for it with `lsusb -d 8086:`, and run: evg-app camera list"


@dataclass(frozen=True)
class CameraInfo:
    """What a camera says of itself; "" where it says nothing.

    Attributes:
        serial: serial number, the name to use when several are connected.
        usb: USB link such as "3.2" or "2.1".
        firmware, recommended: installed firmware, and the one this library wants at least.
    """

    serial: str
    name: str
    firmware: str
    recommended: str
    usb: str

    @property
    def slow_link(self) -> bool:
        """Whether the camera hangs on USB 2."""
        return self.usb.startswith("2")

    def link_advice(self) -> str:
        """What to do about a USB 2 link, "" when the link is fast or unknown."""
        if not self.slow_link:
            return ""
        return (
            f"The camera is on a USB {self.usb} link, too slow for these streams: use a blue USB 3 port of the PC, "
            "the short cable that came with it, no hub; turn the USB-C plug over. Check with: evg-app camera list"
        )


def info_of(rs: Any, device: Any) -> CameraInfo:
    """What a device of librealsense says of itself."""

    def get(key: Any) -> str:
        """One field of the device, empty when it has none."""
        return str(device.get_info(key)) if device.supports(key) else ""

    fields = rs.camera_info
    return CameraInfo(
        serial=get(fields.serial_number),
        name=get(fields.name),
        firmware=get(fields.firmware_version),
        recommended=get(fields.recommended_firmware_version),
        usb=get(fields.usb_type_descriptor),
    )


def list_cameras(rs: Any) -> tuple[CameraInfo, ...]:
    """Every RealSense that librealsense can open, by serial number."""
    found = [info_of(rs, device) for device in rs.context().query_devices()]
    return tuple(sorted((info for info in found if info.serial), key=lambda info: info.serial))


def is_present(rs: Any, serial: str) -> bool:
    """Whether the camera with that serial number is on USB."""
    return any(info.serial == serial for info in list_cameras(rs))


def reset_device(rs: Any, serial: str) -> None:
    """Reset a camera over USB; it leaves the bus and comes back. Nothing happens when it is not there."""
    for device in rs.context().query_devices():
        if info_of(rs, device).serial == serial:
            device.hardware_reset()


def seen_on_usb() -> tuple[str, ...]:
    """Models of the D400 cameras that the kernel sees on USB, whether or not we may open them."""
    models = []
    for product in sorted(USB_DEVICES.glob("*/idProduct")):
        vendor = product.with_name("idVendor")
        model = PRODUCTS.get(product.read_text().strip().lower())
        if model and vendor.is_file() and vendor.read_text().strip().lower() == VENDOR:
            models.append(model)
    return tuple(models)


def choose(rs: Any, serial: str) -> CameraInfo:
    """The camera with that serial number, or the only one when `serial` is empty.

    Raises:
        HardwareError: it is not there; says whether the kernel sees one that we may not open.
        BadInput: several are there and none was named.
    """
    found = list_cameras(rs)
    if serial:
        for info in found:
            if info.serial == serial:
                return info
        raise HardwareError(f"no camera with serial {serial}; {_known(found)}. {_absent(found)}")
    if len(found) > 1:
        raise BadInput(f"{_known(found)}. Name one: set realsense.serial in the camera's YAML, or use --serial")
    return require_any(found)[0]


def require_any(found: tuple[CameraInfo, ...]) -> tuple[CameraInfo, ...]:
    """The cameras that were found.

    Raises:
        HardwareError: none were; says whether the kernel sees one that we may not open.
    """
    if not found:
        raise HardwareError(f"no RealSense camera. {_absent(found)}")
    return found


def _known(found: tuple[CameraInfo, ...]) -> str:
    """Which cameras are connected, in words."""
    listed = ", ".join(f"{info.serial} ({info.name})" for info in found)
    return f"connected: {listed or 'none'}"


def _absent(found: tuple[CameraInfo, ...]) -> str:
    """Why a camera may be missing, and what to do."""
    models = seen_on_usb()
    if len(models) > len(found):
        return (
            f"The kernel sees a {models[0]} that this user may not open, or another program holds it. "
            "Run: evg-app camera udev   (it says how to install the udev rules), then replug the camera"
        )
    return USB_ADVICE
