"""The way to a camera on USB: choice, settings, retries, reset, unplugging; a file plays where the device would be."""

import time

import numpy as np
import pyrealsense2 as rs
import pytest
from recordings import FPS, HEIGHT, SERIAL, WIDTH, write_recording
from stand_in import FIRMWARE, Bus, depth_sensor

from evg_app.cameras.realsense import devices
from evg_app.cameras.realsense.camera import RealSenseCamera
from evg_app.cameras.realsense.settings import apply_settings
from evg_app.clock import WallClock
from evg_app.config.camera import RealSenseModel
from evg_app.config.files import load_camera
from evg_app.errors import BadInput, DeviceTimeout, HardwareError, MissingExtra
from evg_app.identity import identity_of

pytestmark = pytest.mark.slow

CLOCK = WallClock()
STALL_S = 0.5
SLACK_S = 1.0
"""What a busy machine may add to a time to detection."""
FLAT = np.full((HEIGHT, WIDTH), 600, np.uint16)


@pytest.fixture(autouse=True)
def quick(monkeypatch, tmp_path):
    """Short waits where a real camera needs seconds, and a USB bus without cameras."""
    monkeypatch.setattr("evg_app.cameras.realsense.connection.FIRST_FRAME", 0.3)
    monkeypatch.setattr("evg_app.cameras.realsense.link.STOP_TIMEOUT", 0.3)
    monkeypatch.setattr(devices, "USB_DEVICES", tmp_path)


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    """A stream that goes on for ever."""
    return write_recording(tmp_path_factory.mktemp("device") / "good.db3", [FLAT] * 10)


@pytest.fixture(scope="module")
def silent(tmp_path_factory):
    """A stream that starts and gives no depth."""
    return write_recording(tmp_path_factory.mktemp("device") / "silent.db3", [None] * 60 + [FLAT])


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    """A stream that stops for good."""
    return write_recording(tmp_path_factory.mktemp("device") / "once.db3", [FLAT] * 10)


def opened(bus, heard=None, serial="", **changes):
    config = load_camera("d435i")
    quickly = {"stall_s": STALL_S, "warmup_s": 0.0, "average_frames": 1, "reset_timeout_s": 0.5}
    asked = config.realsense.model_copy(update=quickly | changes)
    config = config.model_copy(update={"realsense": asked})
    report = (lambda cause, text: heard.append((cause, text))) if heard is not None else (lambda cause, text: None)
    return RealSenseCamera(config, CLOCK, report, serial, sdk=bus)


def test_the_only_camera_is_started_with_the_configs_streams(good):
    bus = Bus([good]).plug("77")
    with opened(bus) as camera:
        frame = camera.capture(after=0.0, timeout=3.0)
        assert camera.info.serial == "77"
    ((serial, streams, _),) = bus.started
    assert serial == "77"
    assert streams[0] == (rs.stream.depth, 848, 480, rs.format.z16, 30)
    assert streams[1] == (rs.stream.color, 1280, 720, rs.format.rgb8, 30)
    assert (frame.depth == 600).all()


def test_depth_alone_asks_for_no_colour(good):
    bus = Bus([good]).plug("77")
    with opened(bus, color=None):
        assert [stream[0] for stream in bus.started[0][1]] == [rs.stream.depth]


def test_of_several_cameras_one_must_be_named(good):
    bus = Bus([good]).plug("22", "11")
    with pytest.raises(BadInput, match=r"connected: 11 .*, 22 .*Name one.*--serial"):
        opened(bus).__enter__()
    with opened(bus, serial="22") as camera:
        assert camera.info.serial == "22"
        told = identity_of(camera)
        assert (
            told["driver"] == "realsense"
            and told["serial"] == "22"
            and told["firmware"] == FIRMWARE
            and told["pyrealsense2"]
        )
    with opened(bus, serial="11") as one, opened(bus, serial="22") as other:
        assert {one.info.serial, other.info.serial} == {"11", "22"}
        assert one.capture(after=0.0, timeout=3.0).depth.shape == other.capture(after=0.0, timeout=3.0).depth.shape


def test_camera_that_is_not_there_is_named_with_those_that_are(good):
    with pytest.raises(HardwareError, match=r"no camera with serial 99; connected: 77 .*evg-app camera list"):
        opened(Bus([good]).plug("77"), serial="99").__enter__()
    with pytest.raises(HardwareError, match=r"no RealSense camera.*USB 3 port"):
        opened(Bus([good])).__enter__()


def test_camera_that_may_not_be_opened_leads_to_the_udev_rules(good, tmp_path):
    for name, vendor, product in (("1-1", "8086", "0b3a"), ("1-2", "1d6b", "0002"), ("2-3", "046d", "0b07")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "idVendor").write_text(vendor + "\n")
        (tmp_path / name / "idProduct").write_text(product + "\n")
    with pytest.raises(HardwareError, match=r"sees a D435i that this user may not open.*evg-app camera udev"):
        opened(Bus([good])).__enter__()


def test_no_frames_at_first_leads_to_another_start_and_no_reset(good, silent):
    heard = []
    bus = Bus([silent, good]).plug("77")
    with opened(bus, heard) as camera:
        assert (camera.capture(after=0.0, timeout=3.0).depth == 600).all()
    assert [cause for cause, _ in heard] == ["camera start"]
    assert "(77), attempt 1 of 3: no frame within" in heard[0][1]
    assert bus.resets == []


def test_hardware_reset_comes_before_the_last_attempt(good, silent):
    heard = []
    bus = Bus([silent, silent, good]).plug("77")
    with opened(bus, heard) as camera:
        camera.capture(after=0.0, timeout=3.0)
    assert bus.resets == ["77"]
    assert [cause for cause, _ in heard] == ["camera start", "camera start", "camera reset"]


def test_start_that_fails_is_tried_again(good):
    heard = []
    bus = Bus([RuntimeError("failed to set power state"), good]).plug("77")
    with opened(bus, heard) as camera:
        camera.capture(after=0.0, timeout=3.0)
    assert "failed to set power state" in heard[0][1]


def test_camera_that_stays_silent_is_given_up_with_advice_on_its_usb_link(silent):
    bus = Bus([silent]).plug("77", usb="2.1")
    start = CLOCK.now()
    with pytest.raises(HardwareError, match=r"no frame in 3 attempts.*USB 2\.1 link.*USB 3 port"):
        opened(bus).__enter__()
    assert CLOCK.now() - start < 3 * 0.6 + 0.5 + SLACK_S
    assert bus.resets == ["77"] and len(bus.started) == 3


def test_camera_that_does_not_come_back_from_its_reset_is_a_timeout(silent):
    bus = Bus([silent], gone_after_reset=True).plug("77")
    with pytest.raises(DeviceTimeout, match="to come back from its reset"):
        opened(bus).__enter__()


def test_camera_that_somebody_else_has_is_not_reset(good):
    bus = Bus([RuntimeError("xioctl(VIDIOC_S_FMT) failed, errno=16 Last Error: Device or resource busy")]).plug("77")
    with pytest.raises(HardwareError, match="Another program has it"):
        opened(bus).__enter__()
    assert bus.resets == []


def test_streams_that_the_link_is_too_slow_for_are_named(good):
    bus = Bus([good], refuse="Couldn't resolve requests").plug("77", usb="2.1")
    with pytest.raises(HardwareError, match=r"depth 848x480 and colour 1280x720 at 30 Hz.*USB 2\.1"):
        opened(bus).__enter__()


def test_unplugging_in_mid_stream_is_noticed_in_bounded_time(short):
    bus = Bus([short]).plug("77")
    with opened(bus) as camera:
        camera.capture(after=0.0, timeout=3.0)
        time.sleep(12 / FPS)
        bus.cameras.clear()
        start = CLOCK.now()
        with pytest.raises(HardwareError, match=r"camera 77 has left USB.*evg-app camera list"):
            camera.capture(after=start, timeout=5.0)
        assert CLOCK.now() - start < STALL_S + 0.3 + SLACK_S


def test_camera_that_was_plugged_in_again_is_used_again(short, good):
    bus = Bus([short, good]).plug("77")
    with opened(bus) as camera:
        time.sleep(12 / FPS)
        kept, bus.cameras = bus.cameras, []
        with pytest.raises(HardwareError):
            camera.capture(after=CLOCK.now(), timeout=5.0)
        bus.cameras = kept
        assert (camera.capture(after=CLOCK.now(), timeout=3.0).depth == 600).all()


def test_stream_that_dies_while_the_camera_stays_is_started_again(short, good):
    heard = []
    bus = Bus([short, good]).plug("77")
    with opened(bus, heard) as camera:
        time.sleep(12 / FPS)
        start = CLOCK.now()
        frame = camera.capture(after=start, timeout=5.0)
        assert frame.stamp >= start
        assert CLOCK.now() - start < STALL_S + 0.3 + SLACK_S
    assert [cause for cause, _ in heard] == ["camera stall"]


def test_pipeline_that_hangs_in_its_stop_is_left_behind_and_the_next_is_started(short, good):
    bus = Bus([short, good], hang_s=1.0).plug("77")
    camera = opened(bus)
    with camera:
        time.sleep(12 / FPS)
        start = CLOCK.now()
        camera.capture(after=start, timeout=5.0)
        assert CLOCK.now() - start < STALL_S + 0.3 + SLACK_S
        start = CLOCK.now()
    assert CLOCK.now() - start < 0.3 + SLACK_S


def test_failed_entry_leaves_nothing_running(good, monkeypatch):
    camera = opened(Bus([good]).plug("77"), exposure_us=1e9)
    with pytest.raises(BadInput):
        camera.__enter__()
    camera.__exit__(None, None, None)
    with opened(Bus([good]).plug("77")) as again:
        again.capture(after=0.0, timeout=3.0)


def test_settings_are_written_read_back_and_returned():
    _device, sensor = depth_sensor()
    wanted = RealSenseModel(preset="high accuracy", depth_unit_m=0.0001, exposure_us=5000, gain=32, laser_power_mw=240)
    have = apply_settings(rs, sensor, wanted)
    assert have == pytest.approx(
        {
            "preset": 3,
            "depth_unit_m": 0.0001,
            "automatic_exposure": 0,
            "exposure_us": 5000,
            "gain": 32,
            "emitter": 1,
            "laser_power_mw": 240,
            "global_time": 1,
        }
    )
    assert sensor.get_option(rs.option.laser_power) == 240


def test_laser_power_of_zero_switches_the_emitter_off():
    _device, sensor = depth_sensor()
    assert apply_settings(rs, sensor, RealSenseModel(laser_power_mw=0))["emitter"] == 0


@pytest.mark.parametrize(
    ("wanted", "missing", "words"),
    [
        ({"exposure_us": 1e9}, (), r"realsense\.exposure_us: 1e\+09 is outside of 1 to 165000"),
        ({"laser_power_mw": 500}, (), r"realsense\.laser_power_mw: 500 is outside of 0 to 360"),
        ({"laser_power_mw": 100}, ("laser_power",), "no option 'laser_power'"),
        ({"preset": "high density"}, ("visual_preset",), "no option 'visual_preset'"),
    ],
)
def test_setting_that_the_camera_does_not_take_is_named_with_its_range(wanted, missing, words):
    _device, sensor = depth_sensor(*missing)
    with pytest.raises(BadInput, match=words):
        apply_settings(rs, sensor, RealSenseModel(**wanted))


def test_missing_library_names_its_extra(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pyrealsense2", None)
    with pytest.raises(MissingExtra, match=r"\./setup\.sh realsense"):
        RealSenseCamera(load_camera("d435i"), CLOCK).__enter__()


def test_recordings_serial_is_shown(good):
    assert devices.info_of(rs, rs.context().load_device(str(good))).serial == SERIAL
