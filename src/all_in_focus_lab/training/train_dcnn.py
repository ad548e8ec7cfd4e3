#!/usr/bin/python3
# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Train the network of baselines/convolutional.py. The same processor and libraries give the same file; others round
otherwise, and training amplifies that: without AVX the scores (0..1) of held-out pairs have differed by 0.013 in the mean.

Needs a sourced setup.bash and PyTorch (Debian: python3-torch), which nothing else here does. One thread, no GPU.
"""
import argparse
import shutil
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np
from tqdm import tqdm

try:
    import torch
    from torch import nn
except ImportError:
    print("train_dcnn.py: PyTorch is missing: install python3-torch", file=sys.stderr)
    sys.exit(2)

from all_in_focus.command_line import Parser
from all_in_focus_lab.training import patches

SHIPPED = Path(__file__).absolute().parent.parent / "baselines" / "dcnn.onnx"
SEED = 1
PAIRS, HELD_OUT_PAIRS = 40000, 4000
EPOCHS, BATCH, RATE = 6, 128, 2e-3


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
    source, bar = batches(pairs, rng), tqdm(range(steps), unit="batch")
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


def scores(path, pairs):
    """By OpenCV, one for each pair."""
    network = cv2.dnn.readNetFromONNX(path)
    for k, name in enumerate(("one", "other")):
        network.setInput(np.float32(pairs[:, k:k + 1]) / 255, name)
    return network.forward().reshape(-1)


def accuracy(path, pairs):
    return np.mean([scores(path, pairs) > 0.5, scores(path, pairs[:, ::-1]) < 0.5])


def main():
    parser = Parser(prog="train_dcnn.py", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=SHIPPED, metavar="FILE", help="default: the network in the sources")
    args = parser.parse_args()
    if not args.output.absolute().parent.is_dir():
        parser.error(f"{args.output.parent}: there is no such folder")
    torch.set_num_threads(1)
    torch.use_deterministic_algorithms(True)
    cv2.setNumThreads(1)
    held_out = patches.pairs(patches.HELD_OUT, HELD_OUT_PAIRS, SEED + 1)
    network = train(patches.pairs(patches.TRAINING, PAIRS, SEED))
    with tempfile.TemporaryDirectory() as folder:
        path = str(Path(folder) / "dcnn.onnx")
        export(network, path)
        print(f"{Path(path).stat().st_size} bytes, right on {100 * accuracy(path, held_out):.2f} % of pairs of images that it "
              "has not seen")
        shutil.copyfile(path, args.output)


if __name__ == "__main__":
    main()
