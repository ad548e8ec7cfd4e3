# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Bad input of evaluate and compare_segmentation: one clear line each, exit code 2; a failing method stops no other."""
import sys

import cv2
import numpy as np
import pytest
from evaluate_helpers import evaluate, needs_dask, results, rows
from file_helpers import call, cut, pictures, run_script, write_stack
from tool_helpers import expect_refusal

from all_in_focus_lab.baselines import BASELINES
from all_in_focus_lab.benchmark import engine, methods, runner, settings


@pytest.fixture
def scene(tmp_path):
    folder = tmp_path / "scene"
    write_stack(folder, ["source_a.png", "source_b.png"], pictures(2))
    return folder


def refused(*arguments):
    """The lines of a run that is refused."""
    code, out, err = evaluate(*arguments)
    assert (code, out) == (2, "") and "Traceback" not in err, err
    return err.splitlines()


@pytest.mark.parametrize("arguments, complaint", [
    ([], "no scenes: give folders of pictures or bags"),
    (["SCENE", "--methods", "gf,median"], "no method is named 'median'; there are paper, refined, restored, dwt"),
    (["SCENE", "--methods", ""], "no method is named ''"),
    (["SCENE", "--methods", "gf,gf"], "method 'gf' is named twice"),
    (["SCENE", "--methods", "paper:alignment"], "no method is named 'paper:alignment'"),
    (["SCENE", "--metrics", "Q_MI,Q_X"], "no metric is named 'Q_X'; there are Q_MI"),
    (["SCENE", "--jobs", "0"], "expected a positive whole number"),
    (["SCENE", "--jobs", "2", "--scheduler", "tcp://localhost:1"], "give --jobs or --scheduler"),
    pytest.param(["SCENE", "--scheduler", "tcp://127.0.0.1:1"], "tcp://127.0.0.1:1: no Dask scheduler answers", marks=needs_dask),
    pytest.param(["SCENE", "--scheduler", "localhost-1"], "no Dask scheduler answers", marks=needs_dask),
    (["nowhere"], "nowhere: no such scene"),
    (["--config", "nowhere.yaml"], "nowhere.yaml: No such file or directory"),
    (["SCENE", "--bag-option", "timeout"], "expected NAME=VALUE"),
])
def test_arguments(scene, tmp_path, monkeypatch, arguments, complaint):
    monkeypatch.setattr(engine, "ANSWER_S", 0.5)
    lines = refused(*[scene if part == "SCENE" else part for part in arguments], "--output", tmp_path / "out")
    assert len(lines) == 1 and lines[0].startswith("evaluate: ") and complaint in lines[0]
    assert not (tmp_path / "out" / "results.csv").exists()


def test_output_is_needed(scene):
    expect_refusal(run_script("evaluate", scene), "evaluate", "evaluate: --output is needed: the folder for the results\n")


@pytest.mark.parametrize("text, complaint", [
    ("scenes: [a", "not valid YAML"),
    ("[1, 2]", "expected keys and values"),
    ("scene: x", "scene: no such key; there are scenes, methods"),
    ("scenes: [{name: x}]", "a mapping with path"),
    ("scenes: [{path: x, depht: y}]", "depht: no such key; there are path"),
    ("scenes: [{path: 3}]", "path: expected text, not '3'"),
    ("methods: 7", "methods: expected a list"),
    ("bag: 7", "bag: expected options"),
])
def test_configuration(tmp_path, text, complaint):
    (tmp_path / "c.yaml").write_text(text)
    with pytest.raises(settings.SettingsError) as error:
        settings.load(str(tmp_path / "c.yaml"))
    assert complaint in str(error.value) and "\n" not in str(error.value) and "c.yaml" in str(error.value)


def test_a_configuration_survives_being_written(tmp_path):
    (tmp_path / "c.yaml").write_text("scenes: [x, {path: y, name: z, optics: '24,4,0.019'}]\nmethods: [gf]\njobs: 2\n"
                                     "output: out\nbag: {timeout: 5, depth_topic: /d}\n")
    loaded = settings.load(str(tmp_path / "c.yaml"))
    assert loaded.scenes == [{"path": str(tmp_path / "x")},
                             {"path": str(tmp_path / "y"), "name": "z", "optics": "24,4,0.019"}]
    assert loaded.output == str(tmp_path / "out") and loaded.bag == {"timeout": "5", "depth-topic": "/d"}
    (tmp_path / "again.yaml").write_text(loaded.as_yaml())
    assert settings.load(str(tmp_path / "again.yaml")) == loaded


def test_every_scene_that_cannot_be_used_has_a_line(tmp_path):
    two = ["source_a.png", "source_b.png"]
    write_stack(tmp_path / "sizes", two, pictures(1) + pictures(1, (50, 30)))
    write_stack(tmp_path / "cut", two, pictures(2))
    cut(tmp_path / "cut" / "source_b.png")
    write_stack(tmp_path / "one", two[:1], pictures(1))
    (tmp_path / "empty").mkdir()
    write_stack(tmp_path / "truth", two + ["truth.png"], pictures(2) + pictures(1, (50, 30)))
    write_stack(tmp_path / "depth", two, pictures(2))
    cv2.imwrite(str(tmp_path / "depth" / "depth.png"), np.full((32, 48), 1000, np.uint16))
    (tmp_path / "text.bag").write_text("no")
    (tmp_path / "good").mkdir()
    write_stack(tmp_path / "good", two, pictures(2))
    names = ("sizes", "cut", "one", "empty", "truth", "depth", "text.bag")
    lines = refused(*[tmp_path / name for name in names + ("good",)], "--output", tmp_path / "out")
    complaints = dict(zip(names, (
        "source_b.png: 50x30 pixels, but", "source_b.png: truncated or damaged", "two frames are needed, not 1",
        "holds no stack/", "not of the size of the frames", "needs a rig", "not a bag")))
    assert len(lines) == len(names)
    for name, complaint in complaints.items():
        assert sum(str(tmp_path / name) in line and complaint in line for line in lines) == 1, (name, lines)
    assert not (tmp_path / "out").exists()


def test_names_of_scenes(tmp_path):
    for above in ("x", "y"):
        (tmp_path / above).mkdir()
        write_stack(tmp_path / above / "same", ["source_a.png", "source_b.png"])
    arguments = [tmp_path / "x" / "same", tmp_path / "y" / "same", "--output", tmp_path / "out"]
    assert refused(*arguments) == ["evaluate: two scenes are named same: give one of them a name"]
    (tmp_path / "c.yaml").write_text("scenes: [{path: x, name: ../../x}]\noutput: out\n")
    assert "is no name for a folder" in refused("--config", tmp_path / "c.yaml")[0]


def test_what_a_method_does_wrong_is_its_own_failure(scene, tmp_path, monkeypatch):
    def wrong(images):
        return images[0][:5], None

    monkeypatch.setitem(BASELINES, "broken", lambda images: images[99])
    monkeypatch.setitem(BASELINES, "small", wrong)
    said = []
    wanted = settings.Settings([{"path": str(scene)}], ["broken", "gf", "small"], output=str(tmp_path / "out"))
    run, _ = runner.evaluate(wanted, say=said.append)
    assert said == run.failures == ["scene broken: IndexError: list index out of range",
                                    "scene small: the fused image has 48x5 pixels, the frames have 48x32"]
    assert run.results["scene"]["gf"]["values"]["Q_MI"] > 0 and "error" in run.results["scene"]["broken"]


@pytest.mark.parametrize("frames, shares, name, expected", [
    (2, [[0.0, 0.5, 1.0]], "weights", [[0, 32768, 65535]]),
    (2, [[[3.0, 1.0]], [[1.0, 1.0]]], "weights", [[16384, 32768]]),
    (3, [[[0.2, 0.1]], [[0.3, 0.1]], [[0.5, 0.8]]], "source_index", [[2, 2]]),
])
def test_weights_may_be_shares(tmp_path, monkeypatch, frames, shares, name, expected):
    """Of the second of two frames, or of each frame."""
    shape = (8, 8 * len(expected[0]))
    wide = np.kron(np.array(shares), np.ones((8, 8)))
    write_stack(tmp_path / "scene", [f"source_{number}.png" for number in range(frames)], pictures(frames, shape[::-1]))
    monkeypatch.setitem(BASELINES, "soft", lambda images: (images[0], wide))
    wanted = settings.Settings([{"path": str(tmp_path / "scene")}], ["soft"], output=str(tmp_path / "out"))
    run, store = runner.evaluate(wanted)
    assert not run.failures
    assert np.array_equal(cv2.imread(str(store.picture("scene", "soft", name)), -1), np.kron(expected, np.ones((8, 8))))


def test_enfuse_that_is_not_installed(scene, tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    assert "enfuse" not in methods.available() and "gf" in methods.available()
    wanted = settings.Settings([{"path": str(scene)}], ["enfuse", "gf"], output=str(tmp_path / "out"))
    assert runner.evaluate(wanted)[0].failures == ["scene enfuse: enfuse is not installed"]


def test_without_dask_one_job_works(scene, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    wanted = settings.Settings([{"path": str(scene)}], ["gf"], output=str(tmp_path / "out"))
    assert not runner.evaluate(wanted)[0].failures
    wanted.jobs = 2
    with pytest.raises(engine.EngineError, match="--jobs needs Dask: install python3-distributed, or leave it out"):
        runner.evaluate(wanted)


def test_failures_stand_beside_the_results(scene, tmp_path):
    code, out, err = evaluate(scene, "--methods", "gf,given:nobody", "--output", tmp_path / "out")
    assert code == 1 and err.count("\n") == 1 and "holds no fused_nobody.png" in err
    assert [row["error"] != "" for row in rows(tmp_path / "out")] == [False, True]
    assert len(results(tmp_path / "out")["failures"]) == 1


@pytest.mark.parametrize("arguments, complaint", [
    (["--optics", "24,4"], "f,F,coc"),
    (["--scale", "0"], "expected a positive number"),
    (["--sigma", "-1"], "expected a number from 0 on"),
    (["--depth", "nowhere.png"], "nowhere.png: No such file or directory"),
    (["--output", "sheet.doc"], "no image format has this ending"),
])
def test_compare_segmentation(tmp_path, arguments, complaint):
    cv2.imwrite(str(tmp_path / "z.png"), np.full((20, 20), 1000, np.uint16))
    done = call("compare_segmentation", "--depth", tmp_path / "z.png", "--optics", "24,4,0.019", *arguments)
    assert done.returncode == 2 and done.stderr.count("\n") == 1 and complaint in done.stderr, done.stderr


def test_compare_segmentation_needs_depth(tmp_path):
    cv2.imwrite(str(tmp_path / "z.png"), np.zeros((20, 20), np.uint16))
    done = run_script("compare_segmentation", "--depth", tmp_path / "z.png", "--optics", "24,4,0.019")
    assert (done.returncode, done.stdout) == (2, "") and done.stderr.endswith("unknown (0) at every pixel\n")
