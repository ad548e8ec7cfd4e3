# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What was found in a bag: lines of ok, warning and error."""
from dataclasses import dataclass, field
from typing import List

from all_in_focus.files.errors import counted

OK, WARNING, ERROR = "ok", "warning", "error"
MOST = 3  # warnings of one check about single brackets
NEEDING_OTHERS = ("transform", "stamps", "brackets", "depth in time", "depth values", "overlap", "focus steps", "exposure",
                  "focus change")  # checks, in their order


@dataclass
class Finding:
    """check: what was looked at; text: one line that says what is wrong, where, and what to do."""
    check: str
    level: str
    text: str


@dataclass
class BagReport:
    """All findings in the order in which a person would repair them.

    brackets: dicts with bracket_id, frames (how many) and depth (whether it has one).
    """
    bag: str
    findings: List[Finding] = field(default_factory=list)
    brackets: List[dict] = field(default_factory=list)

    @property
    def fusable(self):
        return not any(finding.level == ERROR for finding in self.findings)

    @property
    def skipped(self):
        """Checks that need repairs first: every check that is made finds something, if only that all is well."""
        return [name for name in NEEDING_OTHERS if name not in {finding.check for finding in self.findings}]

    def summary(self):
        errors, warnings = (sum(finding.level == level for finding in self.findings) for level in (ERROR, WARNING))
        text = "can be fused" if self.fusable else "cannot be fused correctly"
        counts = [counted(number, noun) for number, noun in ((errors, "error"), (warnings, "warning")) if number]
        text = f"{self.bag}: {text}" + (f": {', '.join(counts)}" if counts else "")
        return text + ("; not checked because of these errors: " + ", ".join(self.skipped) if self.skipped else "")

    def lines(self):
        width = max(len(finding.check) for finding in self.findings)
        return [f"{finding.level:<7}  {finding.check:<{width}}  {finding.text}" for finding in self.findings]

    def plain(self):
        return {"version": 1, "bag": self.bag, "fusable": self.fusable, "skipped": self.skipped,
                "checks": [vars(finding) for finding in self.findings], "brackets": self.brackets}


class Check:
    """Collects the findings of one check, which ends with ok()."""

    def __init__(self, report, name):
        self._report, self._name = report, name
        self._of_brackets = {}  # text -> numbers of brackets
        self.level = OK  # the worst

    def error(self, text):
        self._add(ERROR, text)

    def warning(self, text):
        self._add(WARNING, text)

    def bracket_warning(self, number, text):
        """About one bracket; ok() makes the same warning about many brackets one line."""
        self._of_brackets.setdefault(text, []).append(number)

    def ok(self, text, brackets=0):
        """Adds a line "ok", unless the check has found something. brackets: how many there are."""
        for warning, numbers in list(self._of_brackets.items())[:MOST]:
            where = f"{len(numbers)} of {brackets} brackets, the first is {numbers[0]}"
            self.warning(f"{where}: {warning}" if brackets > 1 else warning)
        more = len(self._of_brackets) - MOST
        if more > 0:
            self.warning(f"{counted(more, 'more warning')} like these in other brackets")
        if self.level == OK:
            self._add(OK, text)

    def _add(self, level, text):
        self.level = ERROR if ERROR in (level, self.level) else level
        self._report.findings.append(Finding(self._name, level, " ".join(text.split())))


def share_text(share):
    """0.02 -> 2 %."""
    return f"{100 * share:.2g} %" if share < 0.995 else f"{100 * share:.4g} %"
