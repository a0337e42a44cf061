"""A printable board: one PDF page with the pattern at its true size and a ruler to check the print's scale."""

import zlib
from pathlib import Path

import numpy as np

from evg_app.errors import BadInput
from evg_app.handeye.boards import Board

PAPERS = {"a4": (210.0, 297.0), "a3": (297.0, 420.0), "letter": (215.9, 279.4)}
"""Width and height [mm]."""
PIXELS_PER_M = 20000.0
"""Resolution of the printed pattern (508 dpi)."""
RULER_MM = 150
"""Length of the ruler [mm]."""
FOOT_MM = 26.0
"""Room for ruler and text below the pattern [mm]."""
_POINT = 72.0 / 25.4


def write_pdf(board: Board, path: Path, paper: str = "a4") -> None:
    """Write the page.

    Raises:
        BadInput: the board does not fit on the paper.
    """
    page_w, page_h = PAPERS[paper]
    width, height = (1000 * side for side in board.model.size)
    if width > page_w - 10 or height > page_h - FOOT_MM - 8:
        raise BadInput(
            f"board '{board.model.name}' is {width:.0f} x {height:.0f} mm and does not fit on {paper}; "
            f"choose smaller squares or another paper ({', '.join(PAPERS)})"
        )
    left, bottom = (page_w - width) / 2, FOOT_MM + (page_h - FOOT_MM - height) / 2
    drawing = "\n".join([_pattern(left, bottom, width, height), _ruler((page_w - RULER_MM) / 2), _text(board, page_w)])
    path.write_bytes(_document(page_w, page_h, drawing.encode("ascii"), board))


def _pattern(left: float, bottom: float, width: float, height: float) -> str:
    """Draws the picture at a place and size in millimetres."""
    numbers = " ".join(f"{v * _POINT:.4f}" for v in (width, height, left, bottom))
    w, h, x, y = numbers.split()
    return f"q {w} 0 0 {h} {x} {y} cm /Im Do Q"


def _ruler(left: float) -> str:
    """Ticks each millimetre, longer ones each 5 and 10."""
    lines = ["0.3 w"]
    for mm in range(RULER_MM + 1):
        length = 6.0 if mm % 10 == 0 else 4.0 if mm % 5 == 0 else 2.5
        x = (left + mm) * _POINT
        lines.append(f"{x:.3f} {14 * _POINT:.3f} m {x:.3f} {(14 + length) * _POINT:.3f} l S")
        if mm % 50 == 0:
            lines.append(_words(left + mm - 2.5, 10.2, f"{mm}", 8))
    return "\n".join(lines)


def _text(board: Board, page_w: float) -> str:
    """What the board is, and how to print it."""
    m = board.model
    note = f"{m.name}: {m.kind}, {m.columns} x {m.rows}, {1000 * m.square_m:g} / {1000 * m.marker_m:g} mm."
    advice = (
        f"Print at 100 % (no fitting to page). This ruler must measure {RULER_MM} mm. Glue the sheet to a flat plate."
    )
    return "\n".join([_words((page_w - RULER_MM) / 2, 6.0, note, 8), _words((page_w - RULER_MM) / 2, 2.8, advice, 6)])


def _words(x_mm: float, y_mm: float, text: str, size: int) -> str:
    """One line of text at a place in millimetres."""
    safe = text.replace("\\", "\\\\").replace("(", "\\(").replace(")", "\\)")
    return f"BT /F {size} Tf {x_mm * _POINT:.3f} {y_mm * _POINT:.3f} Td ({safe}) Tj ET"


def _document(page_w: float, page_h: float, drawing: bytes, board: Board) -> bytes:
    """A PDF 1.4 file with one page, one 1-bit picture and one font."""
    picture = board.picture(PIXELS_PER_M)
    bits = zlib.compress(np.packbits(picture > 127, axis=1).tobytes(), 9)
    rows, columns = picture.shape
    box = f"0 0 {page_w * _POINT:.3f} {page_h * _POINT:.3f}"
    image = (
        f"/Type /XObject /Subtype /Image /Width {columns} /Height {rows} /ColorSpace /DeviceGray /BitsPerComponent 1"
    )
    resources = "/XObject << /Im 5 0 R >> /Font << /F 6 0 R >>"
    objects = [
        b"<< /Type /Catalog /Pages 2 0 R >>",
        b"<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
        f"<< /Type /Page /Parent 2 0 R /MediaBox [{box}] /Contents 4 0 R /Resources << {resources} >> >>".encode(),
        f"<< /Length {len(drawing)} >>\nstream\n".encode() + drawing + b"\nendstream",
        f"<< {image} /Filter /FlateDecode /Length {len(bits)} >>\nstream\n".encode() + bits + b"\nendstream",
        b"<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica >>",
    ]
    out, places = bytearray(b"%PDF-1.4\n"), []
    for number, body in enumerate(objects, 1):
        places.append(len(out))
        out += f"{number} 0 obj\n".encode() + body + b"\nendobj\n"
    table = "".join(f"{place:010d} 00000 n \n" for place in places)
    start = len(out)
    out += f"xref\n0 {len(objects) + 1}\n0000000000 65535 f \n{table}".encode()
    out += f"trailer\n<< /Size {len(objects) + 1} /Root 1 0 R >>\nstartxref\n{start}\n%%EOF\n".encode()
    return bytes(out)
