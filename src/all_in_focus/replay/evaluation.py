# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What evaluate_bag and the node evaluation_player do: play a bag to the nodes, and save their results."""
from all_in_focus.files.errors import counted
from all_in_focus.replay.player import BagPlayer
from all_in_focus.replay.results import ResultFolder, ResultSaver


def evaluate(contents, output, optics, connect, acknowledge, heartbeat=lambda done: None):
    """Returns what came of it, one line, and warnings. ValueError, OSError.

    contents: BagContents; optics: of the lens, instead of the bag's; the rest: of BagPlayer.
    """
    folder = ResultFolder(output)
    try:
        saver = ResultSaver(folder)

        def alive(done):
            heartbeat(done)
            saver.check()
        player = BagPlayer(contents, connect, acknowledge, alive)
        player.connect(saver.subscribers)
        if optics or contents.optics:
            player.set_optics(optics or contents.optics)
        player.play(follow_optics=optics is None)
        player.end_bracket(saver.has_saved)
        problems = [f"{text} ({times} times)" if times > 1 else text for text, times in player.problems.items()]
        missing = saver.finish()
        warnings = saver.complaints() + problems + contents.problems
        summary = conclude(folder.reports, missing, warnings)
        folder.commit()
        return summary, warnings
    finally:
        folder.discard()


def conclude(reports, missing, warnings):
    """What came of a run, one line; ValueError where it is no result. missing: topics of outputs that never came, by the number
    of the bracket; warnings: of the nodes and the player, worst first."""
    why = ": " + warnings[0] if warnings else ""
    if missing:
        number = min(missing)
        raise ValueError(f"{ResultFolder.name(number)}: {', '.join(missing[number])} never came")
    fused = [report for report in reports if report.frames_used > 0]
    if not fused:
        notes = [note for report in reports for note in report.notes]
        raise ValueError("no bracket was fused" + (f": {notes[0]}" if notes else why))
    # Of large images the fusion may have dropped the labels, and the regions with them. A bag without depth is refused before:
    # fusing by sharpness alone was not asked for.
    if not any(any(choice.label > 0 for choice in report.segments) or not (report.has_labels or report.sharpness_alone)
               for report in fused):
        raise ValueError(f"no region came of the bag's depth{why}")
    unfused = len(reports) - len(fused)
    return f"{counted(len(fused), 'bracket')} fused" + (f", {unfused} could not be" if unfused else "")
