# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Pictures of the report: small copies, weight maps and label maps in colours, crops where methods differ most."""
import base64

import cv2
import numpy as np

from all_in_focus.imaging import NO_FRAME, index_picture, picture
from all_in_focus.files.stack import read_image

WIDTH = 420          # of a small copy, pixels
CROP, CROPS = 96, 3  # side of a crop in pixels, a quarter of a small image at most; how many
UNDECIDED = (200, 80, 200)  # BGR of pixels that no frame has won: a colour that the others do not have


def inline(image, lossless=False):
    """data: address of an image, PNG or JPEG."""
    good, data = cv2.imencode(".png" if lossless else ".jpg", image, [] if lossless else [cv2.IMWRITE_JPEG_QUALITY, 88])
    if not good:
        raise ValueError(f"an image of type {image.dtype} and shape {image.shape} cannot be shown")
    kind = "png" if lossless else "jpeg"
    return f"data:image/{kind};base64,{base64.b64encode(data.tobytes()).decode()}"


def weight_picture(index, frames):
    """Picture of which frame has the most weight. Of two frames the first is black and the second white (W of equation
    11); of more each has a colour, the same for all methods. index: H x W uint16; NO_FRAME: undecided."""
    if frames == 2:
        coloured = cv2.cvtColor(np.where(index == 1, 255, 0).astype(np.uint8), cv2.COLOR_GRAY2BGR)
    else:
        coloured = index_picture(index, frames)
    coloured[index == NO_FRAME] = UNDECIDED
    return coloured


def read_weights(store, scene, method, frames):
    """Picture of a stored result's weights; None where the method tells none."""
    path = store.picture(scene, method, "source_index")
    if path:
        return weight_picture(read_image(path, cv2.IMREAD_UNCHANGED), frames)
    path = store.picture(scene, method, "weights")
    return picture((read_image(path, cv2.IMREAD_UNCHANGED) >> 8).astype(np.uint8)) if path else None


def read_labels(path):
    """Picture of a label map."""
    labels = read_image(path, cv2.IMREAD_UNCHANGED)
    return picture(labels) if labels.dtype == np.uint16 else cv2.cvtColor(labels, cv2.COLOR_GRAY2BGR)


def differences(fused):
    """Windows (x, y, side), at most CROPS, apart from each other, where fused images (H x W x 3 uint8) differ most."""
    if len(fused) < 2:
        return []
    grays = np.stack([cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) for image in fused]).astype(np.float32)
    height, width = grays.shape[1:]
    side = min(CROP, max(8, min(height, width) // 4), height, width)
    deviation = cv2.boxFilter(grays.std(axis=0), -1, (side, side), borderType=cv2.BORDER_CONSTANT)
    inner = np.zeros_like(deviation)  # by centres of windows that lie inside
    centres = (slice(side // 2, height - side + side // 2 + 1), slice(side // 2, width - side + side // 2 + 1))
    inner[centres] = deviation[centres]
    windows = []
    for _ in range(CROPS):
        y, x = np.unravel_index(int(inner.argmax()), inner.shape)
        if inner[y, x] <= 0:
            break
        windows.append((int(x) - side // 2, int(y) - side // 2, side))
        inner[max(0, y - side):y + side, max(0, x - side):x + side] = 0
    return windows


def crop(image, window):
    x, y, side = window
    return image[y:y + side, x:x + side]


def marked(image, windows):
    """A copy with numbered frames around the windows."""
    image = image.copy()
    for number, (x, y, side) in enumerate(windows, 1):
        thickness = max(1, round(image.shape[1] / 320))
        cv2.rectangle(image, (x, y), (x + side - 1, y + side - 1), (0, 0, 255), thickness)
        cv2.putText(image, str(number), (x + 5 * thickness, y + 14 * thickness), cv2.FONT_HERSHEY_SIMPLEX,
                    0.5 * thickness, (0, 0, 255), thickness, cv2.LINE_AA)
    return image
