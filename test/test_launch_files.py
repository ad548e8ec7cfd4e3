# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What the launch files say of themselves."""
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
import roslaunch.config

LAUNCH_FILES = sorted((Path(__file__).resolve().parent.parent / 'launch').glob('*.launch'))


def args_of(path):
    """The args that a caller may give: those without a fixed value."""
    return [arg for arg in ET.parse(path).getroot().findall('arg') if 'value' not in arg.attrib]


@pytest.mark.parametrize('path', LAUNCH_FILES, ids=lambda path: path.name)
def test_every_arg_is_explained(path):
    assert args_of(path)
    assert not [arg.get('name') for arg in args_of(path) if not arg.get('doc')]


def test_what_is_handed_on_has_one_default_and_one_meaning():
    """robot.launch and replay.launch repeat args of all_in_focus.launch."""
    launches = {path.stem: {arg.get('name'): arg for arg in args_of(path)} for path in LAUNCH_FILES}
    for name in ('mode', 'focal_length_mm', 'aperture', 'circle_of_confusion_mm', 'config'):
        texts = {(launches[stem][name].get('default'), launches[stem][name].get('doc'))
                 for stem in ('all_in_focus', 'robot', 'replay')}
        assert len(texts) == 1, texts


@pytest.mark.parametrize('given, expected', [([], None), (['invalid_values:=[0]'], [0]),
                                             (['invalid_values:=[0, 65535]'], [0, 65535])])
def test_invalid_depths_are_chosen_by_an_arg(given, expected):
    config = roslaunch.config.load_config_default([(str(LAUNCH_FILES[0].parent / 'all_in_focus.launch'), given)], None,
                                                  verbose=False)
    param = config.params.get('/depth_preprocess/invalid_values')
    assert (param.value if param else None) == expected


def params(launch, *given):
    config = roslaunch.config.load_config_default([(str(LAUNCH_FILES[0].parent / launch), list(given))], None, verbose=False)
    return {name: param.value for name, param in config.params.items()}


def test_files_are_relative_to_where_roslaunch_is_called(tmp_path, monkeypatch):
    (tmp_path / 'rig').mkdir()
    (tmp_path / 'rig' / 'optics.yaml').write_text('{focal_length_mm: 31.0, aperture: 4.0, circle_of_confusion_mm: 0.02}')
    (tmp_path / 'table.yaml').write_text('{home: far, first: 5, step: 2, focus_table: [{step: 0, mm: 500}, {step: 9, mm: .inf}]}')
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv('PWD', str(tmp_path))
    found = params('robot.launch', 'rig:=rig', 'focus_table:=table.yaml', 'rviz:=false')
    for node in ('focus_bracket_camera', 'rig_publisher'):
        assert found[f'/{node}/rig'] == str(tmp_path / 'rig')
    assert found['/kinect_openni2/depth_camera_info_url'] == str(tmp_path / 'rig' / 'depth.yaml')
    assert found['/segmenter/focal_length_mm'] == 31.0
    assert found['/focus_bracket_camera/home'] == 'far' and found['/focus_bracket_camera/first'] == 5
    assert found['/focus_bracket_camera/step'] == 1  # the arg wins
    assert found['/focus_bracket_camera/focus_table'][1]['step'] == 9
    watched = params('robot.launch', 'rig:=rig', 'focus_table:=table.yaml', 'dslr:=/pictures', 'watch:=true', 'rviz:=false')
    assert watched['/image_folder_camera/focus'] == str(tmp_path / 'table.yaml')
    replayed = params('replay.launch', 'folder:=scene', 'rig:=rig', 'rviz:=false')
    assert replayed['/image_folder_camera/focus'] == str(tmp_path / 'scene' / 'focus.yaml')
    assert replayed['/image_folder_camera/rig'] == str(tmp_path / 'rig')
    played = params('replay.launch', 'bag:=X.bag', 'rig:=rig', 'topics:=names.yaml', 'rviz:=false')
    assert played['/player/topics'] == 'names.yaml' and played['/rig_publisher/rig'] == str(tmp_path / 'rig')
    (tmp_path / 'scene').mkdir()
    found = params('robot.launch', 'kinect:=a.oni', 'dslr:=scene/stack', 'rviz:=false')
    assert found['/kinect_openni2/device'] == str(tmp_path / 'a.oni')
    assert found['/image_folder_camera/stack'] == str(tmp_path / 'scene' / 'stack')
    (tmp_path / 'rig').rename(tmp_path / 'scene' / 'rig')
    found = params('replay.launch', 'folder:=scene', 'rviz:=false')
    assert found['/depth_file_camera/depth'] == str(tmp_path / 'scene' / 'depth.png')
    for given in ('', '#2', '1d27/0601@1/5'):
        assert params('robot.launch', f'kinect:={given}', 'rviz:=false')['/kinect_openni2/device'] == given
    for given in ('', 'Nikon DSC D750'):
        assert params('robot.launch', f'dslr:={given}', 'rviz:=false')['/focus_bracket_camera/model'] == given


@pytest.mark.parametrize('launch, given, told', [
    ('robot.launch', 'rig:=nowhere', 'rig:= must name a rig folder'),
    ('all_in_focus.launch', 'optics:=nowhere.yaml', 'optics:= a file'),
    ('robot.launch', 'config:=nowhere.yaml', 'config:= must name'),
    ('robot.launch', 'focus_table:=nowhere.yaml', 'focus_table:= must name')])
def test_a_missing_file_is_named_with_what_to_do(launch, given, told):
    with pytest.raises(roslaunch.core.RLException) as error:
        params(launch, given)
    assert 'nowhere' in str(error.value) and told in str(error.value)
