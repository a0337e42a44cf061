"""A picture that is written anew with every look: what was found, and where in the picture corners were so far."""

from pathlib import Path

from evg_app.handeye.boards import opencv
from evg_app.handeye.sample import Sample

NAME = "live.jpg"


class LivePicture:
    """Keeps `live.jpg` in a folder; `live_page` shows it in a browser."""

    def __init__(self, folder: Path) -> None:
        """Nothing is written before the first look."""
        self.path = folder / NAME
        self._dots: list[tuple[int, int]] = []

    def show(self, sample: Sample, taken: bool = True) -> None:
        """Draw one sample, or a look that is not `taken`: its corners large, those of earlier samples small."""
        if sample.gray is None:
            return
        cv2 = opencv()
        image = cv2.cvtColor(sample.gray, cv2.COLOR_GRAY2BGR)
        for dot in self._dots:
            cv2.circle(image, dot, 2, (220, 140, 40), -1)
        color = (60, 200, 40) if sample.detection.ok else (60, 60, 230)
        corners = [(round(float(u)), round(float(v))) for u, v in sample.detection.pixels]
        for corner in corners:
            cv2.circle(image, corner, 5, color, 2)
        which = f"sample {sample.number}" if taken else f"before sample {sample.number}"
        text = f"{which}: {len(corners)} corners {sample.detection.problem or 'ok'}"
        cv2.putText(image, text, (8, 20), cv2.FONT_HERSHEY_SIMPLEX, 0.6, color, 2)
        if taken and sample.detection.ok:
            self._dots += corners
        scratch = self.path.with_name(f".{NAME}")
        scratch.write_bytes(cv2.imencode(".jpg", image)[1].tobytes())
        scratch.replace(self.path)
