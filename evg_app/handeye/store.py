"""The folder of one calibration: pictures, depth and joints of every sample, enough to solve it again later."""

import json
from datetime import datetime
from pathlib import Path
from typing import Any
from uuid import uuid4

import numpy as np
import yaml
from PIL import Image

from evg_app.config.calibration import IntrinsicsModel, Mode, pose_of
from evg_app.config.files import read
from evg_app.config.models import Model, Pose
from evg_app.errors import BadInput
from evg_app.handeye.boards import Board, BoardModel
from evg_app.handeye.collect import sample_of
from evg_app.handeye.sample import Sample, Session
from evg_app.types import Frame

SESSION, SAMPLES = "session.yaml", "samples"


class SessionHeader(Model):
    """What all samples of a folder share."""

    mode: Mode
    robot: str
    camera: str
    parent_frame: str
    camera_frame: str
    intrinsics: IntrinsicsModel
    depth_scale_m: float
    T_base_task: Pose
    board: BoardModel
    T_picture_cam: Pose = Pose(xyz_m=(0.0, 0.0, 0.0))
    simulated: bool = False


class RunFolder:
    """Writes samples as they are taken."""

    def __init__(self, folder: Path, simulated: bool = False) -> None:
        """Create it. A simulated one never becomes a file in `calibration/`.

        Raises:
            BadInput: it exists with content, or cannot be written.
        """
        if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
            raise BadInput(
                f"{folder} exists and is not empty; a calibration never overwrites another. Name a new folder"
            )
        try:
            (folder / SAMPLES).mkdir(parents=True)
        except OSError as error:
            raise BadInput(f"{folder} cannot be written: {error.strerror}. Name a folder you may write to") from error
        self.path, self.simulated = folder, simulated
        self.depth_scale = 0.001

    def add(self, sample: Sample, frame: Frame) -> None:
        """Store one sample."""
        self.depth_scale = frame.depth_scale
        stem = self.path / SAMPLES / f"{sample.number:03d}"
        if sample.gray is not None:
            Image.fromarray(sample.gray).save(stem.with_suffix(".png"))
        Image.fromarray(frame.depth).save(stem.with_name(f"{stem.name}_depth.png"))
        facts = {"q_rad": sample.q.tolist(), "T_base_hand": sample.T_base_hand.tolist(), "stamp_s": frame.stamp}
        stem.with_suffix(".json").write_text(json.dumps(facts), encoding="utf-8")

    def finish(self, session: Session) -> None:
        """Write what all samples share."""
        header = SessionHeader(
            mode=session.mode,
            robot=session.robot,
            camera=session.camera,
            parent_frame=session.parent_frame,
            camera_frame=session.camera_frame,
            intrinsics=IntrinsicsModel.of(session.intrinsics),
            depth_scale_m=self.depth_scale,
            T_base_task=pose_of(session.T_base_task),
            board=session.board.model,
            T_picture_cam=pose_of(session.T_picture_cam),
            simulated=self.simulated,
        )
        text = yaml.safe_dump(header.model_dump(mode="json"), sort_keys=False, width=120)
        (self.path / SESSION).write_text(text, encoding="utf-8")


def default_folder() -> Path:
    """`runs/calibrate-<date>-<time>-<6 hex digits>`."""
    return Path("runs") / f"calibrate-{datetime.now():%Y%m%d-%H%M%S}-{uuid4().hex[:6]}"


def is_simulated(folder: Path) -> bool:
    """Whether the samples of a folder were rendered."""
    return read(folder / SESSION, SessionHeader).simulated


def load_session(folder: Path, mode: Mode | None = None) -> Session:
    """Read a folder and detect the board again in every picture. `mode` replaces the stored one.

    Raises:
        BadInput: it is no folder of a calibration, or a sample is damaged.
        ConfigError: its header is broken.
    """
    if not (folder / SESSION).is_file():
        raise BadInput(f"{folder} holds no {SESSION}; --from takes the folder that `evg-app calibrate` wrote")
    header = read(folder / SESSION, SessionHeader)
    board, paths = Board(header.board), sorted((folder / SAMPLES).glob("*.json"))
    samples = [_load_sample(path, header, board) for path in paths]
    if not samples:
        raise BadInput(f"{folder / SAMPLES} holds no samples")
    return Session(
        mode=mode or header.mode,
        robot=header.robot,
        camera=header.camera,
        parent_frame=header.parent_frame,
        camera_frame=header.camera_frame,
        intrinsics=header.intrinsics.value(),
        board=board,
        T_base_task=header.T_base_task.matrix(),
        samples=tuple(samples),
        T_picture_cam=header.T_picture_cam.matrix(),
    )


def _load_sample(path: Path, header: SessionHeader, board: Board) -> Sample:
    """One stored sample; the board is detected anew."""
    try:
        facts: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        gray = np.asarray(Image.open(path.with_suffix(".png")).convert("L"), dtype=np.uint8)
        depth = np.asarray(Image.open(path.with_name(f"{path.stem}_depth.png"))).astype(np.uint16)
        q, T = np.array(facts["q_rad"], dtype=np.float64), np.array(facts["T_base_hand"], dtype=np.float64)
        stamp = float(facts["stamp_s"])
    except (OSError, ValueError, KeyError) as error:
        raise BadInput(
            f"{path} cannot be read ({error}); remove the sample's three files to solve without it"
        ) from error
    color = np.repeat(gray[:, :, None], 3, axis=2)
    frame = Frame(depth, header.depth_scale_m, header.intrinsics.value(), stamp, header.camera_frame, color)
    return sample_of(int(path.stem), q, T, frame, board)
