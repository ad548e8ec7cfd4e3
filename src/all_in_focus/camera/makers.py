# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""How the makers' cameras are focused and kept still: the names of their widgets in libgphoto2, steps, settling."""
from dataclasses import dataclass

CHOICES, RANGE, POSITION = "choices", "range", "position"

MANUAL = ("Manual", "M")
OFF = ("Off", "off")


@dataclass(frozen=True)
class Maker:
    """One row of the table.

    words: any of them in the manufacturer's or the model's name. widgets: the focus drive, the first that is there.
    rule: CHOICES: 'Near N' and 'Far N', N = size of a step; the same choice twice is taken only with 'None' between.
          RANGE: a signed number of motor steps, + is far. POSITION: where the focus is, absolute.
    sizes: smallest and greatest size of a step; typical: the default.
    settle_s: how long the lens takes to come to rest. live_view: the drive works only while live view runs.
    tells_limit: an error says that the end of the focus range is reached; else the lens just stays.
    holds: settings that hold during a bracket: widget -> values, the first that the camera has is taken.
    """
    name: str
    words: tuple
    widgets: tuple
    rule: str
    sizes: tuple
    typical: int
    settle_s: float
    live_view: bool
    tells_limit: bool
    holds: tuple


MAKERS = (
    Maker("Canon EOS", ("canon",), ("manualfocusdrive",), CHOICES, (1, 3), 1, 0.3, True, False,
          (("autoexposuremode", MANUAL), ("autofocus", OFF), ("continuousaf", OFF))),
    Maker("Nikon", ("nikon",), ("manualfocusdrive",), RANGE, (1, 32767), 100, 0.2, True, True,
          (("expprogram", ("M",) + MANUAL), ("autofocus", OFF), ("isoauto", OFF))),
    Maker("Sony", ("sony",), ("manualfocus",), RANGE, (1, 7), 1, 0.3, False, False,
          (("expprogram", ("M",) + MANUAL), ("focusmode", MANUAL))),
    Maker("Fuji", ("fuji",), ("focuspos", "d171"), POSITION, (1, 10000), 10, 0.3, False, True,
          (("expprogram", ("M",) + MANUAL), ("focusmode", MANUAL))),
    Maker("Panasonic", ("panasonic", "lumix"), ("manualfocusdrive",), CHOICES, (1, 2), 1, 0.3, True, False,
          (("expprogram", ("M",) + MANUAL),)),
    Maker("Olympus", ("olympus", "om digital"), ("manualfocusdrive",), CHOICES, (1, 3), 1, 0.3, True, False,
          (("expprogram", ("M",) + MANUAL),)),
)


def maker_of(*texts):
    """The row for a camera by its names (model, manufacturer), None if there is none."""
    text = " ".join(texts).lower()
    return next((maker for maker in MAKERS if any(word in text for word in maker.words)), None)
