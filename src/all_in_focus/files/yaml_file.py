# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Reads and writes YAML files. Errors of reading name the file in one line."""
from pathlib import Path

import yaml

from all_in_focus.files.input_file import require_regular
from all_in_focus.files.output_file import whole_file


def read(path, failure, loader=yaml.SafeLoader):
    """Content of a YAML file. Raises an exception of the type `failure` where the file cannot be read."""
    try:
        require_regular(path)
        text = Path(path).read_text(encoding="utf-8")
        values = [getattr(event, "value", "none") for event in yaml.parse(text)]  # an alias is one event, whatever it holds
        if cut := [key for key, value in zip(values, values[1:]) if key[:1].isdigit() and not value]:  # {focus_mm: 800,5}
            raise ValueError(f"a number ends with ',{cut[0]}': write a decimal point")
        return yaml.load(text, Loader=loader)
    except OSError as error:
        raise failure(f"{path}: {error.strerror}")
    except (yaml.YAMLError, UnicodeDecodeError, ValueError, RecursionError) as error:
        raise failure(f"{path}: not valid YAML: {' '.join(str(error).split())}")


def require_keys(data, known, where):
    """ValueError, which begins with `where`, for what is no mapping, and for a key that is not known: nobody would read it."""
    wrong = [key for key in data if key not in known] if isinstance(data, dict) else [data]
    if wrong:
        raise ValueError(f"{where}: '{wrong[0]}' is none of the keys {', '.join(known)}")


def write(path, data, comment=""):
    """Every number is exact to the last bit. A list of numbers is one line, a list of mappings one line for each. comment:
    lines at the beginning, with their #."""
    flow = None if any(isinstance(value, (dict, list)) for value in data.values()) else False  # None: of what holds no other
    text = yaml.safe_dump(data, sort_keys=False, default_flow_style=flow, width=10 ** 6, allow_unicode=True)
    with whole_file(path) as working:
        working.write_text(comment + text, encoding="utf-8")
