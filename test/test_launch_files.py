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
