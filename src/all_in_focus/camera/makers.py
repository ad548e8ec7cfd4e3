# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""How each maker's cameras are focused, and which settings must not change in a bracket, as libgphoto2 names them."""
import math
from dataclasses import dataclass

CHOICES, RANGE, POSITION, HAND = "choices", "range", "position", "hand"

MANUAL = ("Manual", "M")
OFF = ("Off", "off")


@dataclass(frozen=True)
class Maker:
    """One row of the table.

    words: the row is for cameras with one of them in the name of model or manufacturer.
    widgets: the focus drive; the first one that the camera has is used.
    rule: CHOICES: 'Near N' and 'Far N', N = step size; the camera obeys the same choice again only after 'None'.
          RANGE: a signed number of motor steps, + is far. POSITION: the absolute focus position. HAND: a person turns the
          focus ring, for which there is time before each frame but the first.
    sizes: smallest and greatest step size; typical: the default.
    settle_s: how long the lens takes to come to rest.
    live_view: the drive works only while live view runs.
    reports_limit: an error reports the end of the focus range; otherwise the lens just stops.
    holds: settings that are fixed during a bracket: widget -> values, of which the first that the camera has is set.
    """
    name: str
    words: tuple
    widgets: tuple
    rule: str
    sizes: tuple
    typical: int
    settle_s: float
    live_view: bool
    reports_limit: bool
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

# For cameras that are in no row of the table: those of these settings that they have.
ALL_HOLDS = tuple({name: values for maker in MAKERS for name, values in maker.holds}.items())


def maker_of(*texts):
    """The row for a camera by its names (model, manufacturer); None if there is none."""
    text = " ".join(texts).lower()
    return next((maker for maker in MAKERS if any(word in text for word in maker.words)), None)


def by_hand(maker):
    """The row for a camera, of this row or none, whose focus ring a person turns."""
    return Maker("hand", (), (), HAND, (1, math.inf), 1, 1.0, False, True, maker.holds if maker else ALL_HOLDS)
