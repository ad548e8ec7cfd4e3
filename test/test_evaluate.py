# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""evaluate on scenes of known truth: its numbers are the metrics' numbers, its page needs nothing else."""
import base64
import json
import re
import shutil
import signal
import subprocess
import time
from urllib.parse import unquote

import cv2
import numpy as np
import pytest
from evaluate_helpers import METHODS, Page, evaluate, make_scene, needs_dask, results, rows, start_evaluate
from tool_helpers import read, rosrun, succeeded

from all_in_focus.files.stack import Stack
from all_in_focus_lab import metrics
from all_in_focus_lab.baselines import guided_filtering, laplacian_maximum
from all_in_focus_lab.benchmark.page import differences
from all_in_focus_lab.metrics.truth import Truth, psnr, ssim

SCENES = ("planes", "pair")


@pytest.fixture(scope="module")
def scenes(tmp_path_factory):
    """A generated scene of three frames; its first and last one as a pair with a label map and somebody's result."""
    folder = tmp_path_factory.mktemp("scenes")
    make_scene(folder / "planes")
    frames = list(Stack(str(folder / "planes" / "stack")))
    (folder / "pair").mkdir()
    cv2.imwrite(str(folder / "pair" / "source_a.png"), frames[0])
    cv2.imwrite(str(folder / "pair" / "source_b.png"), frames[-1])
    near = read(folder / "planes" / "truth_depth.png") < 1500
    cv2.imwrite(str(folder / "pair" / "label_front.png"), np.where(near, 255, 0).astype(np.uint8))
    cv2.imwrite(str(folder / "pair" / "fused_other.png"), cv2.cvtColor(frames[1], cv2.COLOR_BGR2GRAY))
    return folder


@pytest.fixture(scope="module")
def output(scenes, tmp_path_factory):
    folder = tmp_path_factory.mktemp("run") / "out"
    code, out, err = evaluate(scenes / "planes", scenes / "pair", "--methods", METHODS + ",given:*", "--output", folder)
    assert code == 1, err  # nobody's result lies beside the generated scene
    missing = f"planes given:other: {scenes / 'planes'}: holds no fused_other.png"
    assert err.splitlines() == ["evaluate: warning: " + missing]
    assert "| paper " in out and out.splitlines()[-1] == str(folder / "report.html")
    return folder


def sources(scenes, name):
    return list(Stack(str(scenes / "planes" / "stack"))) if name == "planes" else [
        read(scenes / "pair" / f"source_{letter}.png") for letter in "ab"]


def test_images_are_those_of_the_methods(scenes, output):
    for name in SCENES:
        frames = sources(scenes, name)
        for method, fuse in (("gf", guided_filtering.fuse), ("laplacian", laplacian_maximum.fuse)):
            fused, weights = fuse(frames)
            folder = output / "results" / name / method
            assert np.array_equal(read(folder / "fused.png"), fused)
            if len(frames) == 2:  # the share of the second
                assert np.abs(read(folder / "weights.png") / 65535 - weights[1]).max() < 1e-5
            else:
                assert np.array_equal(read(folder / "source_index.png"), weights.argmax(axis=0))
    near = read(scenes / "pair" / "label_front.png") == 255
    index = read(output / "results" / "pair" / "paper" / "source_index.png")
    assert len(np.unique(index[near])) == len(np.unique(index[~near])) == 1


def test_numbers_are_those_of_the_metrics(scenes, output):
    """CSV, JSON and page against the metrics applied to the images that were saved."""
    table = {(row["scene"], row["method"]): row for row in rows(output)}
    found = results(output)["results"]
    page = Page(output / "report.html").tables
    truth = Truth.load(str(scenes / "planes"))
    for name in SCENES:
        for column, method in enumerate(METHODS.split(",") + ["given:other"], 2):
            if (name, method) == ("planes", "given:other"):
                assert table[name, method]["error"].endswith("holds no fused_other.png")
                continue
            fused = read(output / "results" / name / method / "fused.png")
            expected = metrics.evaluate(sources(scenes, name), fused)
            if name == "planes":
                expected.update(PSNR=psnr(fused, truth.image), SSIM=ssim(fused, truth.image),
                                PSNR_edges=psnr(fused, truth.image, truth.edges))
            assert found[name][method]["values"] == expected
            shown = page_values(page, name, column)
            assert shown == expected
            for measure, value in expected.items():
                assert float(table[name, method][measure]) == value
            seconds = found[name][method]["seconds"]
            assert method == "given:other" or float(table[name, method]["seconds"]) == seconds > 0


def page_values(tables, scene, column):
    """measure -> value that the page has in a column of T3."""
    values = {}
    for key in ("values-metrics", "values-truth"):
        at = None
        for line in tables[key][1:]:
            at = line[0][0] or at
            if at == scene:
                text, exact = line[column]
                values[line[1][0]] = float(exact)
                assert text.startswith(f"{float(exact):.2f}" if "PSNR" in line[1][0] else f"{float(exact):.4f}")
    return values


def test_scores_of_the_page_are_ranks_of_its_values(output):
    tables = Page(output / "report.html").tables
    totals = {}
    for line in tables["values-metrics"][1:]:
        values = [float(exact) if exact else None for _, exact in line[2:]]
        for (name, _), (text, _), value in zip(tables["values-metrics"][0][2:], line[2:], values):
            if value is None:
                assert text == "-"
                continue
            score = float(text[text.index("(") + 1:-1])
            worse = [other for other in values if other is None or other < value]
            equal = [other for other in values if other is not None and other == value]
            assert score == len(worse) + (len(equal) + 1) / 2
            totals[name] = totals.get(name, 0) + score
    shown = {line[0][0]: float(line[-2][0]) for line in tables["scores-metrics"][1:]}
    assert shown == totals
    ranks = [float(line[-1][0]) for line in tables["scores-metrics"][1:]]
    assert ranks == sorted(ranks) and sum(ranks) == 15
    assert [row["method"] for row in rows(output, "scores.csv") if row["by"] == "metrics"] == list(shown)


def test_page_is_complete_and_needs_no_network(scenes, output):
    page = Page(output / "report.html")
    files = [link for link in page.links if not link.startswith("data:image/")]
    assert files and all((output / unquote(link)).is_file() for link in files)  # nothing outside the folder
    sizes = {}
    for title, address in page.images:
        image = cv2.imdecode(np.frombuffer(base64.b64decode(address.partition(",")[2]), np.uint8), cv2.IMREAD_COLOR)
        sizes.setdefault(title, []).append(image.shape)
        assert image.std() > 1, title  # something can be seen
    # Of two scenes: result, weights, three crops; of the own methods the label map where none is given.
    assert {name: len(of) for name, of in sizes.items() if name in METHODS.split(",")} == {
        "paper": 11, "refined": 11, "gf": 10, "laplacian": 10}
    assert {"truth", "depth", "given", "000.png", "source_a.png"} <= set(sizes)
    text = "".join(page.text)
    for expected in ("Weight maps", "Label maps", "Where the methods differ most, 3", "What failed",
                     "fuse_stack", "numpy", "holds no fused_other.png", str(scenes / "planes")):
        assert expected in text
    assert (output / "configuration.yaml").read_text() in text


def test_weight_maps_have_a_legend_in_their_colours(scenes, output):
    text = (output / "report.html").read_text()
    assert re.search(r"rgb\(255, 35, 35\)\"></i>000\.png, [\d.]+ m", text)  # the first frame is red
    assert "violet for the first" not in text


@pytest.mark.skipif(not shutil.which("chromium"), reason="needs chromium")
def test_a_browser_shows_two_pictures_under_a_border(output, tmp_path):
    """No error on the console; what the border, the switch and a click do, as the page itself tells after them."""
    copy = tmp_path / "out"
    shutil.copytree(output, copy)
    text = (copy / "report.html").read_text()
    probe = """<script>
    window.addEventListener("load", () => {
      const box = document.querySelector(".compare"), [left, right] = box.querySelectorAll("select");
      const [under, over] = box.querySelectorAll(".stage img"), told = [under.naturalWidth > 0 && over.naturalWidth > 0];
      const before = [under.src, over.src];
      box.querySelector("button").click();
      told.push(under.src === before[1] && over.src === before[0]);
      const border = box.querySelector("input");
      border.value = 20; border.dispatchEvent(new Event("input"));
      told.push(over.style.clipPath.includes("20%"));
      const at = under.getBoundingClientRect();
      box.querySelector(".stage").dispatchEvent(new MouseEvent("click", {clientX: at.left + 50, clientY: at.top + 40}));
      told.push(box.querySelectorAll(".places figure").length === left.options.length);
      document.body.dataset.told = told.join();
    });
    </script></body>"""
    (copy / "report.html").write_text(text.replace("</body>", probe))
    done = subprocess.run(["chromium", "--headless", "--no-sandbox", "--disable-gpu", "--enable-logging=stderr", "--dump-dom",
                           f"--user-data-dir={tmp_path / 'profile'}", (copy / "report.html").as_uri()],
                          stdout=subprocess.PIPE, stderr=subprocess.PIPE, universal_newlines=True, check=False)
    assert 'data-told="true,true,true,true"' in done.stdout, done.stderr
    assert ":CONSOLE" not in done.stderr


def test_json_is_json_and_says_what_was_used(output):
    def refuse(name):
        raise AssertionError(name)

    found = json.loads((output / "results.json").read_text(), parse_constant=refuse)
    assert found["methods"] == METHODS.split(",") + ["given:other"] and len(found["failures"]) == 1
    assert {"all_in_focus", "numpy", "cv2", "fuse_stack", "machine"} <= set(found["versions"])
    standing = found["scores"]["truth"]["standings"]["refined"]
    assert standing["total"] == sum(float(score) * times for score, times in standing["times"].items())


def test_runs_go_on_where_they_were_interrupted(scenes, output, tmp_path):
    shutil.copytree(output, tmp_path / "out")
    shutil.rmtree(tmp_path / "out" / "results" / "pair" / "gf")
    kept = {path: path.stat().st_mtime_ns for path in (tmp_path / "out").rglob("result.json")}
    configuration = tmp_path / "out" / "configuration.yaml"
    configuration.write_text(f"# mine\n{configuration.read_text()}")
    code, _, _ = evaluate("--config", configuration, "--output", tmp_path / "out")
    assert configuration.read_text().startswith("# mine\n")  # what the run has read stays
    again = results(tmp_path / "out")
    assert code == 1 and {path: path.stat().st_mtime_ns for path in kept} == kept
    assert again["results"]["pair"]["gf"]["values"] == results(output)["results"]["pair"]["gf"]["values"]
    assert again["results"]["pair"]["gf"]["run"] != again["results"]["pair"]["paper"]["run"]
    assert "Some are of an earlier run." in again["timing"]


def test_changed_input_is_fused_again(scenes, tmp_path):
    shutil.copytree(scenes / "pair", tmp_path / "pair")
    arguments = [tmp_path / "pair", "--methods", "laplacian", "--metrics", "Q_G", "--output", tmp_path / "out"]
    assert evaluate(*arguments)[0] == 0
    before = results(tmp_path / "out")["results"]["pair"]["laplacian"]["values"]
    cv2.imwrite(str(tmp_path / "pair" / "source_a.png"), 255 - read(tmp_path / "pair" / "source_a.png"))
    assert evaluate(*arguments)[0] == 0
    assert results(tmp_path / "out")["results"]["pair"]["laplacian"]["values"] != before


def test_edges_of_a_truth_that_lies_elsewhere(scenes, tmp_path):
    """The optics say which jumps in depth are edges; without them none is known."""
    planes = scenes / "planes"
    truth = f"truth: {planes / 'truth.png'}, truth_depth: {planes / 'truth_depth.png'}"
    (tmp_path / "c.yaml").write_text(f"scenes:\n- {{path: {scenes / 'pair'}, name: with, optics: '50,1.8,0.03', {truth}}}\n"
                                     f"- {{path: {scenes / 'pair'}, name: without, {truth}}}\n")
    code, _, err = evaluate("--config", tmp_path / "c.yaml", "--methods", "laplacian", "--metrics", "Q_MI", "--output",
                            tmp_path / "out")
    found, known = results(tmp_path / "out")["results"], Truth.load(str(planes))
    assert (code, err) == (0, "")
    fused = read(tmp_path / "out" / "results" / "with" / "laplacian" / "fused.png")
    assert found["with"]["laplacian"]["values"]["PSNR_edges"] == psnr(fused, known.image, known.edges)
    assert set(found["without"]["laplacian"]["values"]) == {"Q_MI", "PSNR", "SSIM"}


def test_windows_where_images_differ_lie_apart_and_inside():
    images = [np.zeros((100, 300, 3), np.uint8), np.zeros((100, 300, 3), np.uint8)]
    images[1][40:60, 280:] = 200
    images[1][40:60, :20] = 100
    windows = differences(images)
    assert [side for _, _, side in windows] == [25, 25]
    assert windows[0][0] >= 270 and windows[1][0] <= 10
    assert all(0 <= x <= 275 and 30 <= y <= 45 for x, y, _ in windows)
    assert differences(images[:1]) == [] == differences([images[0]] * 2)


def test_an_interrupted_run_says_so_and_keeps_what_it_has(scenes, tmp_path):
    run = start_evaluate(scenes / "planes", scenes / "pair", "--methods", METHODS, "--output", tmp_path)

    def kept_results():
        return [path for path in tmp_path.glob("results/*/*/result.json") if path.parent.suffix != ".incomplete"]

    while not kept_results():
        assert run.poll() is None
        time.sleep(0.01)
    run.send_signal(signal.SIGINT)
    out, err = run.communicate(timeout=300)
    assert (run.returncode, out, err) == (130, "", "evaluate: interrupted; the same command goes on from here\n")
    kept = len(kept_results())
    assert 0 < kept < 8 and not (tmp_path / "report.html").exists() and not list(tmp_path.rglob("*.incomplete"))


@needs_dask
def test_program_of_the_built_space(scenes, tmp_path):
    """Through rosrun; worker processes start the program anew."""
    done = succeeded(rosrun("evaluate", scenes / "pair", "--methods", "paper,laplacian", "--jobs", "2", "--output", tmp_path))
    assert done.stderr == "" and len(rows(tmp_path)) == 2


def test_any_folder_of_photos(tmp_path):
    """Names as people give them; without a truth the contrast that is kept tells which method is better."""
    folder = tmp_path / "My photos (1)"
    folder.mkdir()
    texture = cv2.GaussianBlur(np.random.default_rng(0).normal(128, 60, (150, 200, 3)), (0, 0), 1)
    for number, left in enumerate((True, False)):
        blurred = cv2.GaussianBlur(texture, (0, 0), 5)
        blurred[:, slice(0, 100) if left else slice(100, 200)] = texture[:, slice(0, 100) if left else slice(100, 200)]
        cv2.imwrite(str(folder / f"IMG_{number}.JPG"), np.clip(blurred, 0, 255), [cv2.IMWRITE_JPEG_QUALITY, 95])
    cv2.imwrite(str(folder / "fused_mean.png"), np.clip((texture + blurred) / 2, 0, 255))
    code, out, err = evaluate(folder, "--methods", "laplacian,dwt,given:mean", "--metrics", "kept_contrast", "--output",
                              tmp_path / "out")
    assert (code, err) == (0, "")
    found = results(tmp_path / "out")["results"]["My_photos_1_"]
    assert all(of["values"] == {} for of in found.values())
    kept = {name: of["contrast"]["kept_contrast"] for name, of in found.items()}
    assert kept["laplacian"] > 0.97 and kept["given:mean"] < 0.9
    assert all(of["contrast"]["kept_contrast_least"] <= of["contrast"]["kept_contrast"] for of in found.values())
    assert 0 < found["laplacian"]["contrast"]["roughness"] < 0.05 and found["dwt"]["contrast"]["roughness"] is None
    table = Page(tmp_path / "out" / "report.html").tables["values-contrast"]
    assert [line[1][0] for line in table[1:]] == ["kept_contrast", "kept_contrast_least", "roughness"]
    assert [float(exact) for _, exact in table[1][2:]] == list(kept.values())
    assert float(rows(tmp_path / "out")[0]["kept_contrast"]) == kept["laplacian"]
    assert "kept_contrast" in out
