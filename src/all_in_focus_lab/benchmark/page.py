# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The report as one HTML page. Its small pictures and tables need nothing else; pictures in full size are files beside it."""
import base64
import math
from pathlib import Path
from typing import NamedTuple

import cv2
import jinja2
import numpy as np

from all_in_focus.files.errors import counted
from all_in_focus.files.stack import Stack, read_depth, read_image
from all_in_focus.imaging import NO_FRAME, index_picture, picture, shrunk
from all_in_focus_lab.benchmark import tables as t

SHOWN_FRAMES = 4     # of a long sweep: the first, the last and some between
LEGEND = 24          # frames, at most
WIDTH = 420          # of a small copy, pixels
CROP, CROPS = 96, 3  # side of a crop in pixels, a quarter of a small image at most; how many
UNDECIDED = (200, 80, 200)  # BGR of pixels that no frame has won: a colour that the others do not have
TEMPLATE = Path(__file__).with_name("report.html")


class Figure(NamedTuple):
    """source: address of the picture; kind: class of the figure, map and crop without loss; full: address of the picture
    in full size, empty without."""
    title: str
    source: str
    kind: str = ""
    caption: str = ""
    full: str = ""


def page(run, tables, store):
    """HTML text for the folder of the run. run: see output_files.Run; tables: tables.Tables; store: where the pictures are;
    it keeps the pictures in full size that the text names."""
    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined)
    environment.filters.update(exact=repr, counted=counted)
    return environment.from_string(TEMPLATE.read_text(encoding="utf-8")).render(
        run=run, tables=tables, t=t, scenes=[_scene(run, scene, tables, store) for scene in run.scenes],
        versions=[[t.Cell(name), t.Cell(value)] for name, value in [("what", "version"), *run.versions.items()]])


# --- one scene --------------------------------------------------------------------------------------------------------

def _scene(run, scene, tables, store):
    """What the template shows of a scene: sources, results, weight maps, label maps, crops, notes."""
    results = run.results[scene.name]
    worked = [name for name in tables.methods if "error" not in results[name]]
    fused = {name: read_image(store.picture(scene.name, name, "fused")) for name in worked}
    windows = differences(list(fused.values()))
    titles = scene.names()
    wanted = {round(i * (len(titles) - 1) / (SHOWN_FRAMES - 1)) for i in range(SHOWN_FRAMES)}
    shown = {titles[n]: frame for n, frame in enumerate(scene.frames()) if n in wanted}
    maps = {name: read_weights(store, scene.name, name, len(titles)) for name in worked}
    silent = [name for name, image in maps.items() if image is None]
    known = _known(scene, shown, windows, store)
    made = [_figure(name, image, caption=_caption(scene, name, tables), full=store.address(scene.name, name))
            for name, image in fused.items()]
    rows = [("Sources and what is known", known), ("Results", made),
            ("Weight maps", [_figure(name, image, "map") for name, image in maps.items() if image is not None]),
            ("Label maps", _labels(scene, worked, store)), *_crops(scene, shown, fused, windows)]
    full = [figure for figure in [*made, *reversed(known)] if figure.full]
    return {"name": scene.name, "path": scene.path, "frames": len(titles), "rows": rows, "full": full,
            "legend": _legend(scene, titles),
            "notes": [f"no weight map from {name}" for name in silent]
            + [f"{name}: {note}" for name in worked for note in results[name].get("notes", [])]}


def _legend(scene, titles):
    """(colour, name and focus distance) of each frame in the weight maps; of a long sweep some."""
    if len(titles) == 2:
        return [("#000", titles[0]), ("#fff; outline: 1px solid #888", titles[1])]
    known = scene.stack and "focus" in scene.beside
    distances = Stack(scene.stack, scene.beside["focus"]).distances if known else [math.nan] * len(titles)
    shown = sorted({round(i * (len(titles) - 1) / (LEGEND - 1)) for i in range(LEGEND)})
    colours = index_picture(np.array([shown], np.uint16), len(titles))[0, :, ::-1]
    return [(f"rgb({', '.join(map(str, colour))})", titles[n] + ("" if math.isnan(distances[n]) else f", {distances[n]:.2f} m"))
            for n, colour in zip(shown, colours.tolist())]


def _figure(title, image, kind="", caption="", full=""):
    if kind != "crop":  # maps keep their colours
        image = shrunk(image, WIDTH, cv2.INTER_NEAREST if kind == "map" else cv2.INTER_AREA)
    return Figure(title, inline(image, bool(kind)), kind, caption, full)


def _known(scene, shown, windows, store):
    known = dict(shown)
    if "truth" in scene.beside:
        known["truth"] = read_image(scene.beside["truth"])
    full = {title: store.keep(scene.name, title, image) for title, image in known.items()}
    *plain, last = known
    return [*(_figure(title, known[title], full=full[title]) for title in plain),
            _figure(last, marked(known[last], windows), caption="with the crops below", full=full[last]),
            *(_figure(key.replace("_", " "), picture(read_depth(scene.beside[key])), "map")
              for key in ("depth", "registered_depth") if key in scene.beside)]


def _caption(scene, method, tables):
    """The first metric, the contrast that is kept, and what the truth says."""
    rows = [row for row in tables.metrics + tables.contrast + tables.truth if row.scene == scene.name]
    values = {row.measure: t.number(row.measure, row.values[method]) for row in rows
              if row.measure in ("PSNR", "PSNR_edges", "kept_contrast", rows[0].measure)}
    return ", ".join(f"{name} {value}" for name, value in values.items())


def _labels(scene, worked, store):
    figures = []
    if "label" in scene.beside:
        figures.append(_figure("given", picture(read_image(scene.beside["label"], cv2.IMREAD_UNCHANGED)), "map"))
        if not {"depth", "registered_depth"} & set(scene.beside):
            return figures  # the package's methods have used this label map
    for name in worked:
        path = store.picture(scene.name, name, "labels")
        if path:
            regions = np.count_nonzero(np.unique(read_image(path, cv2.IMREAD_UNCHANGED)))
            drawn = read_image(store.picture(scene.name, name, "regions"))
            figures.append(_figure(name, drawn, caption=f"regions: {regions}"))  # its captions shrink as a photograph does
    return figures


def _crops(scene, shown, fused, windows):
    beside = dict(shown) if len(shown) == 2 else {}
    if "truth" in scene.beside:
        beside["truth"] = read_image(scene.beside["truth"])
    for number, (x, y, side) in enumerate(windows, 1):
        yield (f"Where the methods differ most, {number}: {side} x {side} pixels at ({x}, {y})",
               [_figure(name, image[y:y + side, x:x + side], "crop") for name, image in {**beside, **fused}.items()])


# --- pictures ---------------------------------------------------------------------------------------------------------

def inline(image, lossless=False):
    """data: address of an image, PNG or JPEG."""
    kind, options = ("png", []) if lossless else ("jpeg", [cv2.IMWRITE_JPEG_QUALITY, 88])
    data = cv2.imencode("." + kind, image, options)[1].tobytes()
    return f"data:image/{kind};base64,{base64.b64encode(data).decode()}"


def read_weights(store, scene, method, frames):
    """Picture of which frame has the most weight in a stored result; None where the method does not tell. Of two frames the
    first is black and the second white (W of equation 11); of more each has a colour, the same for all methods."""
    path = store.picture(scene, method, "source_index")
    if path:
        index = read_image(path, cv2.IMREAD_UNCHANGED)
        coloured = picture(np.uint8(255 * (index == 1))) if frames == 2 else index_picture(index, frames)
        coloured[index == NO_FRAME] = UNDECIDED
        return coloured
    path = store.picture(scene, method, "weights")
    return picture((read_image(path, cv2.IMREAD_UNCHANGED) >> 8).astype(np.uint8)) if path else None


def differences(fused):
    """Windows (x, y, side), at most CROPS, apart from each other, where fused images (H x W x 3 uint8) differ most."""
    if len(fused) < 2:
        return []
    grays = np.stack([cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) for image in fused]).astype(np.float32)
    height, width = grays.shape[1:]
    side = min(CROP, max(8, min(height, width) // 4), height, width)
    deviation = cv2.boxFilter(grays.std(axis=0), -1, (side, side), borderType=cv2.BORDER_CONSTANT)
    inner = np.zeros_like(deviation)  # by centres of windows that lie inside
    centres = (slice(side // 2, height - side + side // 2 + 1), slice(side // 2, width - side + side // 2 + 1))
    inner[centres] = deviation[centres]
    windows = []
    for _ in range(CROPS):
        y, x = np.unravel_index(int(inner.argmax()), inner.shape)
        if inner[y, x] <= 0:
            break
        windows.append((int(x) - side // 2, int(y) - side // 2, side))
        inner[max(0, y - side):y + side, max(0, x - side):x + side] = 0
    return windows


def marked(image, windows):
    """A copy with numbered frames around the windows."""
    image = image.copy()
    for number, (x, y, side) in enumerate(windows, 1):
        thickness = max(1, round(image.shape[1] / 320))
        cv2.rectangle(image, (x, y), (x + side - 1, y + side - 1), (0, 0, 255), thickness)
        cv2.putText(image, str(number), (x + 5 * thickness, y + 14 * thickness), cv2.FONT_HERSHEY_SIMPLEX,
                    0.5 * thickness, (0, 0, 255), thickness, cv2.LINE_AA)
    return image
