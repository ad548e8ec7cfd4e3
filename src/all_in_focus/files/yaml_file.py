# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""YAML files, with errors for people."""
import yaml


def read(path, failure):
    """What a YAML file holds; where it cannot be read, an exception of the type `failure` whose one line names it."""
    try:
        with open(path, encoding="utf-8") as file:
            return yaml.safe_load(file)
    except OSError as error:
        raise failure("%s: %s" % (path, error.strerror))
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise failure("%s: not valid YAML: %s" % (path, " ".join(str(error).split())))
