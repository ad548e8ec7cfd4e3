# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""How an evaluation run stands: a small file that the player writes and evaluate_bag watches."""
import json
from dataclasses import asdict, dataclass, field
from typing import List, Optional

from all_in_focus.files.output_file import whole_file

OK, BAD_INPUT = 0, 2  # exit codes


@dataclass
class RunStatus:
    """code: None while running; reason: one line; brackets: what became of each; done of total: messages played."""
    code: Optional[int] = None
    reason: str = "starting"
    brackets: List[dict] = field(default_factory=list)
    warnings: List[str] = field(default_factory=list)
    done: int = 0
    total: int = 0

    def write(self, path):
        """Replace the file in one step: whoever reads it never sees half of it."""
        if not path:
            return
        with whole_file(path) as working, open(working, "w", encoding="utf-8") as file:
            json.dump(asdict(self), file, indent=2)

    @classmethod
    def read(cls, path):
        """None while there is no file."""
        try:
            with open(path, encoding="utf-8") as file:
                return cls(**json.load(file))
        except FileNotFoundError:
            return None


def conclude(brackets, warnings):
    """Final status. brackets: dicts with folder, bracket_id, frames_used, regions (number of those that depth gave),
    missing (outputs that never came), notes. warnings: what the nodes and the player had to say, worst first."""
    why = ": " + warnings[0] if warnings else ""
    fused = [bracket for bracket in brackets if bracket["frames_used"] > 0]
    incomplete = [bracket for bracket in fused if bracket["missing"]]
    if incomplete:
        code, reason = BAD_INPUT, "%s: %s never came" % (incomplete[0]["folder"], ", ".join(incomplete[0]["missing"]))
    elif fused and not any(bracket["regions"] for bracket in fused):
        # Depth was there, or the bag would have been refused: sharpness alone is not what was asked for.
        code, reason = BAD_INPUT, "no region came of the bag's depth%s" % why
    elif fused:
        unfused = len(brackets) - len(fused)
        code, reason = OK, "%s fused" % _count(len(fused), "bracket")
        if unfused:
            reason += ", %d could not be" % unfused
    else:
        notes = [note for bracket in brackets for note in bracket["notes"]]
        code, reason = BAD_INPUT, "no bracket was fused%s" % (": " + notes[0] if notes else why)
    return RunStatus(code, reason, list(brackets), list(warnings))


def _count(number, noun):
    return "%d %s%s" % (number, noun, "" if number == 1 else "s")
