#!/usr/bin/python3
# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Train the network of baselines/convolutional.py. The same processor and libraries give the same file; others round
otherwise, and training amplifies that: without AVX the scores (0..1) of held-out pairs have differed by 0.013 in the mean.

Needs a sourced setup.bash and PyTorch (Debian: python3-torch), which nothing else here does. One thread, no GPU.
"""
import argparse
import sys
import warnings
from pathlib import Path

import cv2
import numpy as np
import skimage.data

try:
    import torch
    from torch import nn
except ImportError:
    print("train_dcnn.py: PyTorch is missing: install python3-torch", file=sys.stderr)
    sys.exit(2)

from all_in_focus.command_line import Parser
from all_in_focus.files.output_file import whole_file
from all_in_focus.progress import Progress

SHIPPED = Path(__file__).absolute().parent.parent / "baselines" / "dcnn.onnx"
SEED = 1
PAIRS, HELD_OUT_PAIRS = 40000, 4000
EPOCHS, BATCH, RATE = 6, 128, 2e-3

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


# --- pairs of patches, the first sharper than the second, of images that come with scikit-image and SciPy --------------

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


def pairs_of_images(names, count, seed):
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


# --- the network ------------------------------------------------------------------------------------------------------

class Network(nn.Module):
    """Two branches with the same weights, then which of the two is sharper: 1 the first, 0 the second.

    No padding: a patch gives one score, larger images one for each patch, two pixels apart.
    """

    def __init__(self):
        super().__init__()
        self.branch = nn.Sequential(nn.Conv2d(1, 16, 3), nn.ReLU(), nn.Conv2d(16, 24, 3), nn.ReLU(), nn.MaxPool2d(2),
                                    nn.Conv2d(24, 32, 3), nn.ReLU())
        self.head = nn.Sequential(nn.Conv2d(64, 32, 4), nn.ReLU(), nn.Conv2d(32, 1, 1))

    def logit(self, one, other):
        return self.head(torch.cat([self.branch(one), self.branch(other)], dim=1))

    def forward(self, one, other):
        return torch.sigmoid(self.logit(one, other))


def batches(pairs, rng):
    """Endless (one, other, is one the sharper), each pair in random order."""
    while True:
        order = rng.permutation(len(pairs))
        for begin in range(0, len(pairs) - BATCH + 1, BATCH):
            batch = torch.from_numpy(np.float32(pairs[order[begin:begin + BATCH]]) / 255)
            swapped = torch.from_numpy(rng.random(BATCH) < 0.5)
            one, other = (torch.where(swapped[:, None, None], batch[:, 1 - k], batch[:, k])[:, None] for k in (0, 1))
            yield one, other, (~swapped).float()


def train(pairs):
    torch.manual_seed(SEED)
    network, rng = Network(), np.random.default_rng(SEED)
    steps = EPOCHS * (len(pairs) // BATCH)
    optimizer = torch.optim.Adam(network.parameters(), RATE)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, steps)
    source, bar = batches(pairs, rng), Progress(range(steps), unit="batch")
    for step in bar:
        one, other, target = next(source)
        loss = nn.functional.binary_cross_entropy_with_logits(network.logit(one, other).flatten(), target)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        schedule.step()
        if step % 100 == 0:
            bar.set_postfix(loss=f"{loss.item():.4f}")
    return network.eval()


def export(network, path):
    one = torch.zeros(1, 1, 64, 64)
    torch.onnx.export(network, (one, one), path, opset_version=9, input_names=["one", "other"],
                      output_names=["score"])


def accuracy(path, pairs):
    """Share of the pairs that it decides correctly, run by OpenCV; each also in reverse order."""
    network = cv2.dnn.readNetFromONNX(path)
    network.setInput(np.float32(np.concatenate([pairs[:, :1], pairs[:, 1:]])) / 255, "one")
    network.setInput(np.float32(np.concatenate([pairs[:, 1:], pairs[:, :1]])) / 255, "other")
    scores = network.forward().reshape(2, -1)
    return np.mean([scores[0] > 0.5, scores[1] < 0.5])


def main():
    parser = Parser(prog="train_dcnn.py", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=SHIPPED, metavar="FILE", help="default: the network in the sources")
    args = parser.parse_args()
    if not args.output.absolute().parent.is_dir():
        parser.error(f"{args.output.parent}: there is no such folder")
    torch.set_num_threads(1)
    torch.use_deterministic_algorithms(True)
    cv2.setNumThreads(1)
    held_out = pairs_of_images(HELD_OUT, HELD_OUT_PAIRS, SEED + 1)
    network = train(pairs_of_images(TRAINING, PAIRS, SEED))
    with whole_file(args.output) as path:
        export(network, str(path))
        print(f"{path.stat().st_size} bytes, right on {100 * accuracy(str(path), held_out):.2f} % of pairs of images that it "
              "has not seen")


if __name__ == "__main__":
    main()
