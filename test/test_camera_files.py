# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Pictures that come as files: from libgphoto2's own camera of a folder, and into a folder that is watched."""
import itertools

import cv2
import numpy as np
import pytest

from all_in_focus.camera import folder_watch
from all_in_focus.camera.folder_watch import Arrival, BracketGrouper, FolderWatch
from all_in_focus.camera.interface import FILE_NOT_FOUND, NOT_SUPPORTED, CameraError
from all_in_focus.files.stack import StackError
from file_helpers import VirtualTime, cut, pictures, write_pages

gphoto = pytest.importorskip("all_in_focus.camera.gphoto", reason="python3-gphoto2 is not installed")


@pytest.fixture
def disk(tmp_path):
    """libgphoto2's "Directory Browse" camera, opened, and the folder with its pictures."""
    folder = tmp_path / "card" / "DCIM" / "100CANON"
    folder.mkdir(parents=True)
    camera = gphoto.GphotoCamera(f"disk:{tmp_path / 'card'}", "Directory Browse")
    assert camera.open() == "Directory Browse"
    yield camera, folder
    camera.close()


def test_download_and_delete(disk):
    camera, folder = disk
    picture = pictures(1)[0]
    cv2.imwrite(str(folder / "IMG_1.PNG"), picture)
    camera.open()  # libgphoto2 remembers what is in a folder
    data = camera.download("/DCIM/100CANON/IMG_1.PNG")
    assert data == (folder / "IMG_1.PNG").read_bytes()
    np.testing.assert_array_equal(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR), picture)
    camera.delete("/DCIM/100CANON/IMG_1.PNG")
    assert not (folder / "IMG_1.PNG").exists()
    with pytest.raises(CameraError, match="^downloading /DCIM/100CANON/IMG_1.PNG: ") as failure:
        camera.download("/DCIM/100CANON/IMG_1.PNG")
    assert failure.value.code == FILE_NOT_FOUND


@pytest.mark.parametrize("call, arguments", [("capture", ()), ("capture_preview", ()), ("get_config", ("iso",)),
                                             ("set_config", ("iso", "100")), ("wait_for_event", (0.01,))])
def test_what_a_folder_cannot_do(disk, call, arguments):
    with pytest.raises(CameraError, match="the camera does not support this") as failure:
        getattr(disk[0], call)(*arguments)
    assert failure.value.code == NOT_SUPPORTED and not failure.value.lost


def test_a_closed_camera_is_a_lost_one(disk):
    disk[0].close()
    disk[0].close()
    with pytest.raises(CameraError) as failure:
        disk[0].download("/a.jpg")
    assert failure.value.lost


@pytest.mark.parametrize("port, model", [("", "Canon EOS 80D"), ("usb:999,999", "Canon EOS 80D"), ("usb:999,999", "")])
def test_no_camera_is_explained(port, model):
    with pytest.raises(CameraError, match="no camera found: switch it on and check the USB cable") as failure:
        gphoto.GphotoCamera(port, model).open()
    assert failure.value.lost


def test_a_model_is_looked_for_among_those_plugged_in():
    found = gphoto.gp.CameraList()
    for model, port in (("Nikon DSC D750", "usb:001,004"), ("Canon EOS 80D", "usb:001,005")):
        found.append(model, port)
    assert gphoto.GphotoCamera("", "Canon EOS 80D")._port_among(found) == "usb:001,005"
    # Where the port is given, too, the model says how the camera there is to be spoken to.
    assert gphoto.GphotoCamera("usb:001,004", "Canon EOS 80D")._port_among(found) == "usb:001,004"
    with pytest.raises(CameraError, match="'Canon EOS 6D' is not among those found: 'Nikon DSC D750' at usb:001,004, "):
        gphoto.GphotoCamera("", "Canon EOS 6D")._port_among(found)


@pytest.mark.parametrize("port, model", [("usb:", "stack"), ("nowhere", "")])
def test_names_that_libgphoto2_does_not_know(port, model):
    """A folder that is not absolute looks like a model to robot.launch."""
    with pytest.raises(CameraError, match="^(model 'stack'|port 'nowhere'): libgphoto2 does not know this name: see"):
        gphoto.GphotoCamera(port, model).open()


@pytest.fixture(autouse=True)
def virtual_time(monkeypatch):
    return VirtualTime(monkeypatch, folder_watch)


@pytest.fixture
def watched(tmp_path):
    """A folder with an old picture and its watch."""
    cv2.imwrite(str(tmp_path / "old.png"), pictures(1)[0])
    return tmp_path, FolderWatch(str(tmp_path), itertools.count().__next__, patience=0.05)


def polled(watch, times=2):
    """Names and stamps of what arrives."""
    return [(arrival.name, arrival.stamp) for _ in range(times) for arrival in watch.poll()]


def test_new_pictures_arrive_once(watched):
    folder, watch = watched
    assert polled(watch) == []
    cv2.imwrite(str(folder / "b.png"), pictures(1)[0])
    (folder / "notes.txt").write_text("no picture")
    (folder / ".hidden.png").write_bytes(b"")
    assert watch.poll() == []  # it may still grow
    assert polled(watch) == [("b.png", 0)]
    for name in ("d.jpg", "c.jpg"):
        cv2.imwrite(str(folder / name), pictures(1)[0])
    assert polled(watch, 3) == [("c.jpg", 2), ("d.jpg", 3)]


def test_a_camera_that_writes_raw_files_alone(watched, virtual_time):
    folder, watch = watched
    (folder / "1.NEF").write_bytes(b"raw")
    assert polled(watch) == [] and not watch.warnings
    virtual_time.sleep(0.1)
    assert polled(watch) == [] and "1.NEF came, and no picture: let the camera write JPEG" in watch.warnings.pop()
    (folder / "2.NEF").write_bytes(b"raw")
    virtual_time.sleep(0.1)
    assert polled(watch) == [] and not watch.warnings


def test_raw_files_beside_pictures(watched, virtual_time):
    folder, watch = watched
    (folder / "1.NEF").write_bytes(b"raw")
    cv2.imwrite(str(folder / "1.jpg"), pictures(1)[0])
    assert polled(watch) == [("1.jpg", 1)]
    virtual_time.sleep(0.1)
    assert polled(watch) == [] and not watch.warnings


def test_pages_arrive_as_pictures(watched):
    folder, watch = watched
    frames = pictures(2)
    write_pages(folder / "two.tif", frames)
    watch.poll()
    arrivals = watch.poll()
    assert [arrival.name for arrival in arrivals] == ["two.tif, page 1", "two.tif, page 2"]
    np.testing.assert_array_equal([arrival.image for arrival in arrivals], frames)


def test_an_overwritten_picture_arrives_again(watched):
    folder, watch = watched
    picture = pictures(2)[1]
    cv2.imwrite(str(folder / "old.png"), picture)
    watch.poll()
    arrival, = watch.poll()
    np.testing.assert_array_equal(arrival.image, picture)


@pytest.mark.parametrize("suffix", ["png", "jpg"])
def test_a_picture_is_read_when_it_is_complete(watched, suffix):
    folder, watch = watched
    cv2.imwrite(str(folder / ("whole." + suffix)), pictures(1)[0])
    data = (folder / ("whole." + suffix)).read_bytes()
    watch.poll()
    assert len(polled(watch)) == 1
    for share in (0.3, 0.6, 1.0):  # a slow copy, with pauses
        (folder / ("slow." + suffix)).write_bytes(data[:int(len(data) * share)])
        names = [name for name, _ in polled(watch, 3)]
    assert names == ["slow." + suffix] and not watch.warnings


def test_a_damaged_picture_is_given_up(watched, virtual_time):
    folder, watch = watched
    cv2.imwrite(str(folder / "bad.png"), pictures(1)[0])
    cut(folder / "bad.png")
    assert polled(watch) == []
    virtual_time.sleep(0.1)
    assert polled(watch) == []
    assert [line for line in watch.warnings if "bad.png: truncated or damaged; left out" in line] == watch.warnings
    assert len(watch.warnings) == 1


def test_a_picture_that_is_written_while_it_is_read_comes_once(watched, monkeypatch):
    folder, watch = watched
    data = cv2.imencode(".png", pictures(1)[0])[1].tobytes()
    (folder / "slow.png").write_bytes(data[:len(data) // 2])
    read = folder_watch.read_pages

    def finished_meanwhile(path):
        (folder / "slow.png").write_bytes(data)
        monkeypatch.setattr(folder_watch, "read_pages", read)
        return read(path)

    monkeypatch.setattr(folder_watch, "read_pages", finished_meanwhile)
    assert polled(watch, times=5) == [("slow.png", 0)]


def test_the_stamp_of_a_deleted_file_is_not_that_of_a_later_one(watched):
    folder, watch = watched
    for image in pictures(2):
        cv2.imwrite(str(folder / "1.png"), image)
        assert watch.poll() == []
        (folder / "1.png").rename(folder / ".1.png")
        watch.poll()
    (folder / ".1.png").rename(folder / "1.png")
    assert polled(watch) == [("1.png", 2)]


def test_a_folder_may_go_and_come_back(watched):
    folder, watch = watched
    folder.rename(folder.parent / "away")
    with pytest.raises(StackError, match="No such file or directory"):
        watch.poll()
    (folder.parent / "away").rename(folder)
    assert polled(watch) == []


def numbered(frame):
    return frame and (frame.image, frame.bracket_id, frame.index, frame.count, frame.last)


def test_brackets_of_known_size():
    grouper = BracketGrouper(size=2)
    assert [numbered(grouper.after(Arrival(name, name, 0))) for name in "abc"] == [
        ("a", 0, 0, 2, False), ("b", 0, 1, 2, True), ("c", 1, 0, 2, False)]
    assert grouper.after() is None


def test_brackets_that_end_with_a_pause(virtual_time):
    grouper = BracketGrouper(gap=0.05)
    a, b, c = (Arrival(name, name, 0) for name in "abc")
    assert grouper.after(a) is None and grouper.after() is None
    assert numbered(grouper.after(b)) == ("a", 0, 0, 0, False)
    virtual_time.sleep(0.06)
    assert numbered(grouper.after()) == ("b", 0, 1, 2, True) and grouper.after() is None
    assert grouper.after(c) is None
    virtual_time.sleep(0.06)
    assert numbered(grouper.after()) == ("c", 1, 0, 1, True)
