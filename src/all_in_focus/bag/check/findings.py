# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What was found in a bag: lines of ok, warning and error."""
from dataclasses import dataclass, field
from typing import List

from all_in_focus.files.errors import counted

OK, WARNING, ERROR = "ok", "warning", "error"


@dataclass
class Finding:
    """check: what was looked at; text: one line that says what is wrong, where, and what to do."""
    check: str
    level: str
    text: str


@dataclass
class BagReport:
    """All findings in the order in which a person would repair them. skipped: checks that need these repairs first.

    brackets: dicts with bracket_id, frames (how many) and depth (whether it has one).
    """
    bag: str
    findings: List[Finding] = field(default_factory=list)
    skipped: List[str] = field(default_factory=list)
    brackets: List[dict] = field(default_factory=list)

    @property
    def fusable(self):
        return not any(finding.level == ERROR for finding in self.findings)

    def failed(self, check):
        """Whether this check found an error."""
        return any(finding.check == check and finding.level == ERROR for finding in self.findings)

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
        """The report as plain dicts and lists."""
        return {"version": 1, "bag": self.bag, "fusable": self.fusable, "skipped": self.skipped,
                "checks": [vars(finding) for finding in self.findings], "brackets": self.brackets}


class Check:
    """Collects the findings of one check; ends with one line "ok" where it found nothing."""

    def __init__(self, report, name):
        self._report, self._name = report, name
        self.clean = True

    def error(self, text):
        self._add(ERROR, text)

    def warning(self, text):
        self._add(WARNING, text)

    def ok(self, text):
        """Adds a line "ok", unless the check has found something."""
        if self.clean:
            self._report.findings.append(Finding(self._name, OK, text))

    def _add(self, level, text):
        self.clean = False
        self._report.findings.append(Finding(self._name, level, " ".join(text.split())))


class PerBracket:
    """Warnings of a check about single brackets; the same warning about many brackets becomes one line."""

    MOST = 3  # lines

    def __init__(self, check, brackets):
        self._check, self._brackets, self._numbers = check, brackets, {}

    def warning(self, number, text):
        self._numbers.setdefault(text, []).append(number)

    def report(self):
        for text, numbers in list(self._numbers.items())[:self.MOST]:
            where = f"bracket {numbers[0]}"
            if len(numbers) > 1:
                where = "all brackets" if len(numbers) == self._brackets else \
                    f"{len(numbers)} of {self._brackets} brackets, the first is {numbers[0]}"
            self._check.warning(f"{where}: {text}" if self._brackets > 1 else text)
        more = len(self._numbers) - self.MOST
        if more > 0:
            self._check.warning(f"{counted(more, 'more warning')} like these in other brackets")


def share_text(share):
    """0.02 -> 2 %."""
    return f"{100 * share:.2g} %" if share < 0.995 else f"{100 * share:.4g} %"
