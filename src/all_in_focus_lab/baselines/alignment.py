# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Alignment of a bracket to its middle frame from the pictures alone (ECC, Evangelidis and Psarakis 2008)."""
import cv2
import numpy as np

CRITERIA = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 100, 1e-6)
GAUSSIAN_SIZE = 5  # pixels, of the filter that evens out different sharpness


def _step(template, image):
    """Affine 3 x 3 from pixels of one gray image to those of its neighbour; identity where ECC does not converge."""
    affine = np.eye(3, dtype=np.float32)
    try:
        _, affine[:2] = cv2.findTransformECC(template, image, affine[:2].copy(), cv2.MOTION_AFFINE, CRITERIA, None,
                                             GAUSSIAN_SIZE)
    except cv2.error:
        pass
    return affine


def align(images):
    """List of H x W x 3 uint8 (BGR) -> the same, each warped onto frame N // 2.

    Neighbours in the sweep are most alike, so they are aligned with each other, outward from the reference.
    """
    grays = [cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) for image in images]
    reference = len(images) // 2
    aligned = list(images)
    for order in (range(reference + 1, len(images)), range(reference - 1, -1, -1)):
        from_reference, before = np.eye(3, dtype=np.float32), reference
        for number in order:
            from_reference, before = _step(grays[before], grays[number]) @ from_reference, number
            aligned[number] = cv2.warpAffine(images[number], from_reference[:2], images[number].shape[1::-1],
                                             flags=cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP,
                                             borderMode=cv2.BORDER_REPLICATE)
    return aligned
