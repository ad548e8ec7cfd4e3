# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Files that are whole or not there, and errors that name the file that was asked for."""
import numpy as np
import pytest
from file_helpers import call, file_limit, run_script
from tool_helpers import TwoPlanes, expect_refusal, snapshot, succeeded

from all_in_focus.files.output_file import named, whole_file, write_picture


def test_a_file_appears_whole_or_not_at_all(tmp_path):
    path = tmp_path / "a.txt"
    for text in ("old", "new"):
        with whole_file(str(path)) as working, open(working, "w") as file:
            file.write(text)
            assert not path.exists() or path.read_text() == "old"
    with pytest.raises(ZeroDivisionError), whole_file(str(path)) as working, open(working, "w") as file:
        file.write("half")
        1 / 0
    assert snapshot(tmp_path) == {"a.txt": b"new"}


@pytest.mark.parametrize("name, kind", [("none/a.png", FileNotFoundError), ("folder", IsADirectoryError),
                                        ("file/a.png", NotADirectoryError)])
def test_errors_name_what_was_asked_for(tmp_path, name, kind):
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").write_bytes(b"")
    before, path = snapshot(tmp_path), str(tmp_path / name)
    with pytest.raises(kind) as error:
        write_picture(path, np.zeros((4, 4), np.uint8))
    assert error.value.filename == path and error.value.filename2 is None
    assert snapshot(tmp_path) == before


def test_other_errors_stay_as_they_are(tmp_path):
    for place, told in ((tmp_path / "w" / "x", str(tmp_path / "o" / "x")), (tmp_path / "wx", str(tmp_path / "wx"))):
        with pytest.raises(FileNotFoundError) as error, named(str(tmp_path / "o"), str(tmp_path / "w")):
            open(place)
        assert error.value.filename == told
    with pytest.raises(ValueError, match="a.nonsense: no image format has this ending: use .png"):
        write_picture("a.nonsense", np.zeros((4, 4), np.uint8))


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return TwoPlanes(tmp_path_factory.mktemp("scene"))


@pytest.mark.parametrize("name, options", [
    ("contact_sheet", "{0}/depth.png"),
    ("check_rig", "--registered-depth {0}/depth.png --color {0}/stack/00.png"),
    ("make_bag", "--depth {0}/depth.png --rig {0}/rig --stack {0}/stack"),
    ("compare_segmentation", "--depth {0}/depth.png --optics 24,4,0.019"),
])
def test_a_missing_folder_is_told_with_the_file_as_it_was_given(scene, tmp_path, name, options):
    output = str(tmp_path / "none" / "o.png")
    done = call(name, *options.format(scene.folder).split(), "--output", output)
    assert done.returncode == 2 and done.stderr.splitlines()[-1] == f"{name}: {output}: No such file or directory"
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("kb", [0, 4, 16])
def test_a_full_disk_is_told_of_a_bag(scene, tmp_path, kb):
    """The LZ4 of rosbag fails once more when the bag is closed, and does not say why."""
    done = run_script("make_bag", *scene.with_depth, "--stack", scene.stack, "--output", tmp_path / "x.bag",
                      preexec_fn=file_limit(kb), restore_signals=False)
    expect_refusal(done, "make_bag", f"{tmp_path / 'x.bag'}: File too large")
    assert not list(tmp_path.iterdir())


def test_so_it_is_for_a_folder(scene, tmp_path):
    bag, output = scene.folder / "scene.bag", tmp_path / "none" / "stack"
    succeeded(call("make_bag", *scene.with_depth, "--stack", scene.stack, "--output", bag))
    done = call("bag_to_stack", bag, "--output", output)
    assert done.returncode == 2 and done.stderr == f"bag_to_stack: {output}: No such file or directory\n"
    (tmp_path / "file").write_text("")
    output = tmp_path / "file" / "scene"
    done = call("make_scene", "--scene", "planes", "--output", output)
    assert done.returncode == 2 and done.stderr.endswith(f"make_scene: {output}: Not a directory\n")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
