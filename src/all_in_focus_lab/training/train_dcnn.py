#!/usr/bin/python3
# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Train the network of baselines/convolutional.py, or check that training gives the network that is there.

Needs a sourced setup.bash and PyTorch (Debian: python3-torch), which nothing else here does. One thread, no GPU.
"""
import argparse
import filecmp
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
# Of the scores (0..1) of held-out pairs. The same processor and libraries give the same file; others round otherwise,
# and training amplifies that: without AVX it has come to 0.013 and 0.009.
MEAN_TOLERANCE, DECISION_TOLERANCE = 0.03, 0.02


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


def agrees(one, other, pairs):
    """Print how far the scores of two networks are apart; is it within the tolerance?"""
    if filecmp.cmp(one, other, shallow=False):
        print("the same file, byte by byte")
        return True
    found = [scores(path, pairs) for path in (one, other)]
    difference, decisions = np.abs(found[0] - found[1]), (found[0] > 0.5) != (found[1] > 0.5)
    print(f"scores differ by {difference.mean():.5f} in the mean (at most {MEAN_TOLERANCE:g}), {difference.max():.5f} at the "
          f"most; other decisions: {decisions.mean():.5f} (at most {DECISION_TOLERANCE:g})")
    return difference.mean() <= MEAN_TOLERANCE and decisions.mean() <= DECISION_TOLERANCE


def main():
    parser = Parser(prog="train_dcnn.py", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true",
                        help="compare with --output, write nothing; exit code 1: they differ")
    parser.add_argument("--output", type=Path, default=SHIPPED, metavar="FILE", help="default: the network in the sources")
    args = parser.parse_args()
    if args.check and not args.output.is_file():
        parser.error(f"{args.output}: there is no such file")
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
        if args.check:
            sys.exit(0 if agrees(path, args.output, held_out) else 1)
        shutil.copyfile(path, args.output)


if __name__ == "__main__":
    main()
