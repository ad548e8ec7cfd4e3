# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The part of the page that shows one scene."""
from html import escape

import cv2
import numpy as np

from all_in_focus.benchmark import pictures, tables as t
from all_in_focus.imaging import picture
from all_in_focus.files.stack import read_depth, read_image

SHOWN_FRAMES = 4  # of a long sweep: the first, the last and some between


def section(run, scene, tables, store):
    """HTML of a scene: sources, results, weight maps, label maps, crops, remarks."""
    results = run.results[scene.name]
    worked = [name for name in tables.methods if "error" not in results[name]]
    fused = {name: read_image(store.picture(scene.name, name, "fused")) for name in worked}
    windows = pictures.differences(list(fused.values()))
    frames, shown = _some_frames(scene)
    parts = ["<h2>%s</h2><p><small>%s, %d frames</small></p>" % (escape(scene.name), escape(scene.path), frames)]
    parts.append(_row("Sources and what is known", _known(scene, shown, windows)))
    parts.append(_row("Results", [(name, pictures.small(image), "", _caption(scene, name, tables))
                                  for name, image in fused.items()]))
    maps = {name: pictures.read_weights(store, scene.name, name, frames) for name in worked}
    legend = ("black: first frame, white: second" if frames ==
              2 else "a colour for each frame, from violet for the first to dark red for the last")
    silent = [name for name, image in maps.items() if image is None]
    parts.append(_row("Weight maps (%s)%s" % (legend, "; none told by " + ", ".join(silent) if silent else ""),
                      [(name, pictures.small_map(image), "map", "")
                       for name, image in maps.items() if image is not None]))
    parts.append(_row("Label maps", _labels(scene, worked, store)))
    parts += _crops(scene, shown, fused, windows)
    remarks = ["%s: %s" % (name, note) for name in worked for note in results[name].get("notes", [])]
    if remarks:
        parts.append("<h3>Remarks</h3><ul>%s</ul>" % "".join("<li>%s</li>" % escape(line) for line in remarks))
    return "\n".join(parts)


def _some_frames(scene):
    """(number of frames, some of them by title)."""
    titles = scene.names()
    wanted = {round(i * (len(titles) - 1) / (SHOWN_FRAMES - 1)) for i in range(SHOWN_FRAMES)}
    return len(titles), {titles[n]: frame for n, frame in enumerate(scene.frames()) if n in wanted}


def _row(title, figures):
    """figures: (title, image, class, caption); nothing where there are none."""
    if not figures:
        return ""
    shown = "".join("<figure class=\"%s\"><img class=\"%s\" alt=\"%s\" src=\"%s\"><figcaption>%s%s</figcaption>"
                    "</figure>\n" % (kind, kind, escape(name), pictures.inline(image, bool(kind)), escape(name),
                                     "<br><small>%s</small>" % escape(caption) if caption else "")
                    for name, image, kind, caption in figures)
    return "<h3>%s</h3><div class=\"pictures\">%s</div>" % (escape(title), shown)


def _known(scene, shown, windows):
    figures = [(title, pictures.small(image), "", "") for title, image in shown.items()]
    if "truth" in scene.beside:
        truth = read_image(scene.beside["truth"])
        figures.append(("truth", pictures.small(pictures.marked(truth, windows)), "", "with the crops below"))
    else:
        last = list(shown)[-1]
        figures[-1] = (last, pictures.small(pictures.marked(shown[last], windows)), "", "with the crops below")
    for key in ("depth", "registered_depth"):
        if key in scene.beside:
            image = pictures.small_map(picture(read_depth(scene.beside[key])))
            figures.append((key.replace("_", " "), image, "map", ""))
    return figures


def _caption(scene, method, tables):
    """The first metric, the contrast that is kept, and what the truth says."""
    rows = [row for row in tables.metrics + tables.contrast + tables.truth if row.scene == scene.name]
    told = {row.measure: t.number(row.measure, row.values[method]) for row in rows
            if row.measure in ("PSNR", "PSNR_edges", "kept_contrast", rows[0].measure)}
    return ", ".join("%s %s" % item for item in told.items())


def _labels(scene, worked, store):
    figures = []
    if "label" in scene.beside:
        figures.append(("given", pictures.small_map(pictures.read_labels(scene.beside["label"])), "map", ""))
        if not {"depth", "registered_depth"} & set(scene.beside):
            return figures  # the own methods have used just that
    for name in worked:
        path = store.picture(scene.name, name, "labels")
        if path:
            figures.append((name, pictures.small_map(pictures.read_labels(path)), "map", _regions(path)))
    return figures


def _regions(path):
    labels = read_image(path, cv2.IMREAD_UNCHANGED)
    return "regions: %d" % np.count_nonzero(np.unique(labels))


def _crops(scene, shown, fused, windows):
    beside = dict(shown) if len(shown) == 2 else {}
    if "truth" in scene.beside:
        beside["truth"] = read_image(scene.beside["truth"])
    found = []
    for number, window in enumerate(windows, 1):
        title = "Where the methods differ most, %d: %d x %d pixels at (%d, %d)" % (
            number, window[2], window[2], *window[:2])
        found.append(_row(title, [(name, pictures.crop(image, window), "crop", "")
                                  for name, image in list(beside.items()) + list(fused.items())]))
    return found
