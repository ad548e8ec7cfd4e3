# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Reads YAML files; its errors name the file in one line."""
from pathlib import Path

import yaml

from all_in_focus.files.input_file import require_regular


def read(path, failure, loader=yaml.SafeLoader):
    """Content of a YAML file. Raises an exception of the type `failure` where the file cannot be read."""
    try:
        require_regular(path)
        return yaml.load(Path(path).read_text(encoding="utf-8"), Loader=loader)
    except OSError as error:
        raise failure(f"{path}: {error.strerror}")
    except (yaml.YAMLError, UnicodeDecodeError, ValueError, RecursionError) as error:
        raise failure(f"{path}: not valid YAML: {' '.join(str(error).split())}")
