# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Runs of evaluate, and its page read back."""
import csv
import json
import shutil
import sys
from html.parser import HTMLParser

import pytest
from file_helpers import call, environment, script, start
from tool_helpers import made_scene

try:
    import distributed
except ImportError:  # that of Debian 11 does not ask for python3-tornado, which it needs
    distributed = None

METHODS = "paper,refined,gf,laplacian"
needs_dask = pytest.mark.skipif(not distributed, reason="NOT TESTED WITH DASK: python3-distributed cannot be imported")


DASK = {"DASK_DISTRIBUTED__COMM__TIMEOUTS__CONNECT": "10s"}


def start_evaluate(*arguments):
    return start([sys.executable, script("evaluate"), *arguments], env=environment(**DASK))


def evaluate(*arguments):
    """(exit code, stdout, stderr)."""
    done = call("evaluate", *arguments)
    return done.returncode, done.stdout, done.stderr


def make_scene(folder, scene="planes", seed=0, breathing=0):
    shutil.copytree(made_scene("--scene", scene, "--size", "160x120", "--frames", 3, "--optics", "50,1.8,0.03",
                               "--seed", seed, "--breathing", breathing), folder)
    return folder


def results(folder):
    return json.loads((folder / "results.json").read_text())


def rows(folder, name="results.csv"):
    with open(folder / name, encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


class Page(HTMLParser):
    """tables: id -> rows of cells (text, value that stands beside it or None); images: (title, address); text; links:
    everything that a browser would fetch."""

    OPEN = {"html", "head", "body", "title", "style", "h1", "h2", "h3", "p", "div", "table", "thead", "tbody", "tr",
            "th", "td", "small", "figure", "figcaption", "ul", "li", "code", "pre", "a", "script", "label", "select", "option",
            "button", "span", "i"}

    def __init__(self, path):
        super().__init__()
        self.tables, self.images, self.links, self.text = {}, [], [], []
        self._open, self._rows, self._cell = [], [], None
        self.feed(path.read_text(encoding="utf-8"))
        assert not self._open, self._open

    def handle_starttag(self, tag, attributes):
        attributes = dict(attributes)
        self.links += [value for name, value in attributes.items() if name in ("src", "href", "action", "srcset")]
        if tag == "option" and "value" in attributes:
            self.links.append(attributes["value"])
        if tag == "img":
            if "src" in attributes:  # the others are set by the script
                self.images.append((attributes["alt"], attributes["src"]))
        if tag in self.OPEN:
            self._open.append(tag)
        else:
            assert tag in ("img", "br", "meta", "input"), tag
        if tag == "table":
            self._rows = self.tables.setdefault(attributes["id"], [])
        elif tag == "tr":
            self._rows.append([])
        elif tag in ("td", "th"):
            self._cell = ["", attributes.get("data-value")]

    def handle_endtag(self, tag):
        assert self._open.pop() == tag
        if tag in ("td", "th"):
            self._rows[-1].append(tuple(self._cell))
            self._cell = None

    def handle_data(self, data):
        self.text.append(data)
        if self._cell is not None:
            self._cell[0] += data
