# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Pairs of patches, the first sharper than the second, of images that come with scikit-image and SciPy."""
import warnings

import cv2
import numpy as np
import skimage.data

SIZE = 16               # pixels
TRAINING = ("ascent", "astronaut", "brick", "chelsea", "coins", "face", "grass", "gravel", "hubble_deep_field",
            "immunohistochemistry", "moon", "motorcycle", "page", "rocket", "text")
HELD_OUT = ("camera", "coffee")
SMALLEST_IMAGE = 200    # pixels; larger ones are taken at half size, too, where they are sharp to the pixel
WIDTHS = (0, 1, 2, 2.8, 3.5, 4, 4.5)  # sigma in pixels: the paper's, sigma 2 applied one to five times, and less
CAMERAS = 6             # versions of an image, each with its own softness, exposure, noise and compression
SOFTNESS, NOISE, QUALITY = 0.8, 3, (75, 99)  # sigma in pixels, standard deviation in gray values, of JPEG
EXPOSURE, FLICKER = 0.5, 0.03  # greatest change of gain; difference of it in a pair
SHIFT = 2               # pixels, that the two may be apart: photographs are aligned no better
MIN_GRADIENT = 3        # mean of the patch, gray values for a pixel


def image(name):
    """Gray, H x W uint8."""
    if name in ("ascent", "face"):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # to be moved; the new place downloads
            import scipy.misc
            found = np.uint8(getattr(scipy.misc, name)())
    elif name == "motorcycle":
        found = skimage.data.stereo_motorcycle()[0]
    else:
        found = getattr(skimage.data, name)()
    return found if found.ndim == 2 else cv2.cvtColor(np.ascontiguousarray(found[..., :3]), cv2.COLOR_RGB2GRAY)


def photographed(picture, gain, rng):
    """As a camera would hand it over; picture: H x W float32, 0..255."""
    noisy = picture * gain + rng.normal(0, rng.uniform(0, NOISE), picture.shape)
    eight_bit = np.uint8(np.clip(np.rint(noisy), 0, 255))
    quality = int(rng.integers(*QUALITY))
    return cv2.imdecode(cv2.imencode(".jpg", eight_bit, (cv2.IMWRITE_JPEG_QUALITY, quality))[1], cv2.IMREAD_GRAYSCALE)


def gradient_energy(picture):
    """Mean magnitude of the gradient in the patch that begins at each pixel; H x W float32."""
    dx, dy = (cv2.Sobel(picture, cv2.CV_32F, *order, scale=1 / 8) for order in ((1, 0), (0, 1)))
    return cv2.blur(np.hypot(dx, dy), (SIZE, SIZE), anchor=(0, 0))


def pairs_of(picture, count, rng):
    """count x 2 x SIZE x SIZE uint8 of a picture (H x W float32): sharper, less sharp."""
    reach = SIZE + SHIFT
    softened = cv2.GaussianBlur(picture, (0, 0), rng.uniform(0.1, SOFTNESS))
    energy = gradient_energy(softened)[SHIFT:-reach, SHIFT:-reach]
    places = np.argwhere(energy > MIN_GRADIENT) + SHIFT
    places = places[rng.permutation(len(places))[:count]]
    gain = 1 + rng.uniform(-EXPOSURE, EXPOSURE / 2)
    versions = [photographed(cv2.GaussianBlur(softened, (0, 0), width) if width else softened,
                             gain * (1 + rng.uniform(-FLICKER, FLICKER)), rng) for width in WIDTHS]
    pairs = []
    for y, x in places:
        first = 0 if rng.random() < 0.7 else int(rng.integers(1, len(WIDTHS) - 2))
        second = int(rng.integers(first + 1, len(WIDTHS)))
        dy, dx = rng.integers(-SHIFT, SHIFT + 1, 2)
        pair = [versions[first][y:y + SIZE, x:x + SIZE], versions[second][y + dy:y + dy + SIZE, x + dx:x + dx + SIZE]]
        pair = np.rot90(pair, int(rng.integers(4)), axes=(1, 2))
        pairs.append(pair[..., ::-1] if rng.random() < 0.5 else pair)
    return np.array(pairs, np.uint8).reshape(-1, 2, SIZE, SIZE)


def pairs(names, count, seed):
    """About count x 2 x SIZE x SIZE uint8 in random order, as many of each image."""
    rng = np.random.default_rng(seed)
    found = []
    for name in names:
        whole = np.float32(image(name))
        half = cv2.resize(whole, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
        versions = [whole, half] if min(half.shape) >= SMALLEST_IMAGE else [whole]
        for number in range(CAMERAS):
            found.append(pairs_of(versions[number % len(versions)], count // (CAMERAS * len(names)), rng))
    found = np.concatenate(found)
    return found[rng.permutation(len(found))]
