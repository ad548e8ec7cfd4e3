# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""State of an evaluation run: a small file that the player writes and evaluate_bag watches."""
import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import List, Optional

from all_in_focus.files.errors import counted
from all_in_focus.files.output_file import write_json

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
        """Replaces the file in one step, so that nobody reads half of it; does nothing without a path."""
        if path:
            write_json(path, asdict(self))

    @classmethod
    def read(cls, path):
        """None while there is no file."""
        try:
            return cls(**json.loads(Path(path).read_text(encoding="utf-8")))
        except FileNotFoundError:
            return None


def conclude(brackets, warnings):
    """Final status. brackets: dicts with folder, bracket_id, frames_used, has_depth, missing (outputs that never
    came), notes. warnings: of the nodes and the player, worst first."""
    why = ": " + warnings[0] if warnings else ""
    fused = [bracket for bracket in brackets if bracket["frames_used"] > 0]
    incomplete = [bracket for bracket in fused if bracket["missing"]]
    if incomplete:
        code, reason = BAD_INPUT, f"{incomplete[0]['folder']}: {', '.join(incomplete[0]['missing'])} never came"
    elif fused and not any(bracket["has_depth"] for bracket in fused):
        # A bag without depth is refused before: fusing by sharpness alone was not asked for.
        code, reason = BAD_INPUT, f"no region came of the bag's depth{why}"
    elif fused:
        unfused = len(brackets) - len(fused)
        code, reason = OK, f"{counted(len(fused), 'bracket')} fused"
        if unfused:
            reason += f", {unfused} could not be"
    else:
        notes = [note for bracket in brackets for note in bracket["notes"]]
        code, reason = BAD_INPUT, "no bracket was fused" + (f": {notes[0]}" if notes else why)
    return RunStatus(code, reason, list(brackets), list(warnings))
