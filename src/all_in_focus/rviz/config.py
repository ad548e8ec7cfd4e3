# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What an .rviz file listens to."""
import posixpath

import yaml

TOPIC_KEYS = ("Image Topic", "Color Image Topic", "Depth Map Topic", "Marker Topic", "Topic")


def _read(path):
    """Raises OSError, ValueError (one line)."""
    with open(path, encoding="utf-8") as file:
        try:
            config = yaml.safe_load(file)
            config["Visualization Manager"]["Displays"], config["Visualization Manager"]["Global Options"]
            return config
        except (yaml.YAMLError, KeyError, TypeError) as error:
            raise ValueError("%s: not an rviz configuration (%s)" % (path, " ".join(str(error).split()))) from error


def displays(path):
    """The enabled displays of an .rviz file, as it describes them. Raises OSError, ValueError (one line)."""
    return [display for display in _read(path)["Visualization Manager"]["Displays"] if display.get("Enabled", True)]


def write_with_frame(path, frame, output):
    """Copy an .rviz file with another fixed frame: DepthCloud keeps to that of the file, whatever rviz -f says."""
    config = _read(path)
    config["Visualization Manager"]["Global Options"]["Fixed Frame"] = frame
    with open(output, "w", encoding="utf-8") as file:
        yaml.safe_dump(config, file)


def topics_of(display):
    """Topics that a display subscribes; with a depth image goes the camera_info beside it."""
    names = [display[key] for key in TOPIC_KEYS if isinstance(display.get(key), str) and display[key]]
    if display.get("Depth Map Topic"):
        names.append(posixpath.join(posixpath.dirname(display["Depth Map Topic"]), "camera_info"))
    return names


def topics(path):
    """Topics that the displays subscribe, in order. Raises like displays()."""
    return list(dict.fromkeys(name for display in displays(path) for name in topics_of(display)))
