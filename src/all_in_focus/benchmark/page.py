# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The report as one HTML page that needs nothing but itself."""
from html import escape

from all_in_focus.benchmark import scene_section, tables as t

STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; color: #222; margin: 2em auto; max-width: 1500px; padding: 0 1em; }
h1, h2, h3 { line-height: 1.2; } h2 { margin-top: 2em; border-bottom: 1px solid #bbb; } h3 { margin-bottom: .3em; }
table { border-collapse: collapse; margin: .6em 0; font-variant-numeric: tabular-nums; }
.wide { overflow-x: auto; } p.caption { color: #555; margin: 1em 0 0; max-width: 60em; }
th, td { padding: .15em .7em; text-align: right; white-space: nowrap; }
th:first-child, td:first-child, .text td, .text th { text-align: left; }
thead th { border-bottom: 1px solid #555; } tbody tr:hover { background: #f0f4fa; }
tr.group td { border-top: 1px solid #bbb; } td.best { font-weight: bold; } small { color: #777; }
.pictures { display: flex; flex-wrap: wrap; gap: .8em; } figure { margin: 0; } figcaption { font-size: 13px; }
img { display: block; max-width: 100%; image-rendering: auto; } img.map, img.crop { image-rendering: pixelated; }
figure { width: 330px; } figure.crop { width: 192px; } img { width: 100%; }
.failed { color: #a00; } pre { background: #f4f4f4; padding: .8em; overflow-x: auto; }
"""


def page(run, tables, store):
    """HTML text. run: see report.Run; tables: tables.Tables; store: where the pictures are."""
    counts = tuple("%d %s%s" % (len(of), noun, "" if len(of) == 1 else "s")
                   for of, noun in ((run.scenes, "scene"), (tables.methods, "method")))
    parts = ["<h1>Fusion of %s by %s</h1>" % counts, _failures(run)]
    parts.append("<h2>Scores and ranks</h2>")
    if tables.metrics:
        parts.append(_standings(tables, tables.metrics,
                                "By the metrics %s. The best of N methods has score N in each row of the table of "
                                "values, equal ones have the mean; a failed method has none. These metrics reward "
                                "copying: see the truth, where it is known." % ", ".join(run.settings.metrics)))
    if tables.truth:
        parts.append(_standings(tables, tables.truth,
                                "By the known all-in-focus truth: PSNR, SSIM, PSNR within 8 px of depth edges."))
    parts.append("<h2>Values</h2>")
    parts.append(_values(tables, tables.metrics, "Value and (score) of each metric; higher is better."))
    parts.append(_values(tables, tables.contrast,
                         "Without any truth: share of the contrast that some frame shows which the result keeps (mean "
                         "over all scales, and the least; higher is better), and roughness of the map of winners, the "
                         "share of neighbours from different frames (lower is better)."))
    if tables.truth:
        parts.append(_values(tables, tables.truth,
                             "Against the truth: PSNR in dB, SSIM, PSNR within 8 px of depth edges."))
    parts.append("<h2>Seconds</h2>" + _seconds(run, tables))
    parts += [scene_section.section(run, scene, tables, store) for scene in run.scenes]
    parts.append("<h2>Configuration and versions</h2>" + _versions(run))
    return ("<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>Evaluation of image fusion</title>"
            "<style>%s</style></head><body>\n%s\n</body></html>\n" % (STYLE, "\n".join(parts)))


def _failures(run):
    if not run.failures:
        return ""
    lines = "".join("<li>%s</li>" % escape(line) for line in run.failures)
    return "<h2>What failed</h2><ul class=\"failed\">%s</ul>" % lines


def _table(name, caption, heading, lines):
    """heading: texts; lines: (class of the row, cells as HTML)."""
    head = "".join("<th>%s</th>" % escape(text) for text in heading)
    body = "".join("<tr class=\"%s\">%s</tr>\n" % (kind, "".join(cells)) for kind, cells in lines)
    return ("<p class=\"caption\">%s</p><div class=\"wide\"><table id=\"%s\"><thead><tr>%s</tr></thead><tbody>\n%s"
            "</tbody></table></div>" % (escape(caption), name, head, body))


def _text(text):
    return "<td>%s</td>" % escape(text)


def _number(text, value, best=False, more=""):
    """A cell that keeps the whole value beside the rounded one."""
    exact = " data-value=\"%r\" title=\"%r\"" % (value, value) if value is not None else ""
    return "<td%s%s>%s%s</td>" % (" class=\"best\"" * best, exact, escape(text), more)


def _kind(rows):
    measure = rows[0].measure if rows else ""
    return "truth" if measure in t.TRUTH_MEASURES else "contrast" if measure in t.CONTRAST_MEASURES else "metrics"


def _standings(tables, rows, caption):
    heading, *lines = t.standing_cells(tables, rows)
    return _table("scores-" + _kind(rows), caption, heading,
                  [("", [_text(line[0])] + [_number(cell, float(cell)) for cell in line[1:]]) for line in lines])


def _values(tables, rows, caption):
    lines, scene = [], None
    for row in rows:
        best = max((score for score in row.scores.values() if score is not None), default=None)
        cells = [_text(row.scene if row.scene != scene else ""), _text(row.measure)]
        for name in tables.methods:
            value, score = row.values[name], row.scores[name]
            more = " <small>(%s)</small>" % t.score(score) if score is not None else ""
            cells.append(_number(t.number(row.measure, value), value, score is not None and score == best, more))
        lines.append(("" if row.scene == scene else "group", cells))
        scene = row.scene
    return _table("values-" + _kind(rows), caption, ["scene", "measure"] + tables.methods, lines)


def _seconds(run, tables):
    def cells(title, times):
        least = min((value for value in times if value is not None), default=None)
        return [_text(title)] + [_number(t.number("seconds", value), value, value is not None and value == least)
                                 for value in times]

    lines = [("", cells(scene, list(of.values()))) for scene, of in tables.seconds.items()]
    lines.append(("group", cells("mean", [tables.mean_seconds(name) for name in tables.methods])))
    return _table("seconds", "From frames in memory to the fused image, once. " + run.timing_note,
                  ["scene"] + tables.methods, lines)


def _versions(run):
    rows = [("", [_text(name), _text(value)]) for name, value in run.versions.items()]
    table = _table("versions", "Measured with", ["what", "version"], rows)
    return ("<div class=\"text\">%s</div><p>The same settings as <code>configuration.yaml</code>, beside this page:</p>"
            "<pre id=\"configuration\">%s</pre>" % (table, escape(run.settings.as_yaml())))
