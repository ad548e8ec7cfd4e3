# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Metric of preserved features: Q_P, and phase congruency."""
import functools
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from scipy.fftpack import fft2, ifft2  # scipy.fft begins with SciPy 1.4

from all_in_focus_lab.metrics.images import Local, ratio, remembered

SIZE, SIGMA = 11, 1.5  # pixels, of the Gaussian window
FEATURE = 0.1          # phase congruency above which a pixel counts
C = 1e-4

# Of phase congruency.
SCALES, ORIENTATIONS = 4, 6
SHORTEST_WAVE, SCALE_FACTOR = 3, 2.1   # pixels; from one scale to the next
BANDWIDTH = 0.55                       # sigma of a radial filter over its centre frequency
ANGLE_SIGMA = np.pi / ORIENTATIONS / 1.2
LOW_PASS, LOW_PASS_ORDER = 0.45, 15
NOISE_SIGMAS, NOISE_REDUCTION = 2, 1.7
WIDTH_CUT_OFF, WIDTH_GAIN = 0.5, 10    # of the sigmoid that favours a wide spread over frequencies
EPS = 1e-4


def correlation(one, other):
    """Of two maps (Local) around each pixel."""
    return (one.covariance(other) + C) / (np.sqrt(np.abs(one.variance * other.variance)) + C)


def q_p(sources, fused):
    """Zhao, Laganiere, Liu, "Performance assessment of combinative pixel-level image fusion based on an absolute
    feature measurement", International Journal of Innovative Computing, Information and Control 3(6A), 2007. Arguments:
    see the package. Range 0..1.

    Product of three numbers, one each for phase congruency and its two moments: the local correlation of the fused map
    with that of the source, or of the strongest source, that correlates best, over the pixels that have features. More
    sources: more to choose from.
    """
    masks, maps = _masks_and_maps(*sources)
    count = masks[-1].sum()
    if count == 0:
        return float("nan")
    product = 1.0
    for of_sources, values in zip(maps, phase_congruency(fused)):
        target = Local(values, SIZE, SIGMA)
        best = np.max([mask * correlation(source, target) for source, mask in zip(of_sources, masks)], axis=0)
        product *= best.sum() / count
    return float(product)


@remembered
def _masks_and_maps(*sources):
    """For each source, and for the image made of the strongest source at each pixel: a mask of the pixels with features,
    and the maps (Local) by kind."""
    with ThreadPoolExecutor() as pool:  # numpy releases the interpreter lock
        maps = np.array(list(pool.map(phase_congruency, sources)))
    # Of equally strong sources the last.
    strongest = len(sources) - 1 - maps[::-1, 0].argmax(axis=0)
    maps = np.concatenate([maps, np.take_along_axis(maps, strongest[None, None], axis=0)])
    masks = maps[:, 0] > FEATURE
    return masks, [[Local(source * mask, SIZE, SIGMA) for source, mask in zip(of_kind, masks)]
                   for of_kind in maps.swapaxes(0, 1)]


# --- phase congruency -------------------------------------------------------------------------------------------------

def _low_pass(shape):
    rows, columns = ((np.arange(n) - n // 2) / n for n in shape)
    radius = np.sqrt(rows[:, None] ** 2 + columns ** 2)
    # As in the published values: fftshift here, ifftshift elsewhere. For odd sizes they differ.
    return np.fft.fftshift(1 / (1 + (radius / LOW_PASS) ** (2 * LOW_PASS_ORDER)))


@functools.lru_cache(maxsize=2)
def _filters(shape):
    """Radial filters (one per scale), H x W each in the order of the FFT; and for each orientation its angle, the angular
    factor of its filters, and the responses to white noise of the finest one and of the even parts of all together."""
    y, x = (np.fft.ifftshift((np.arange(n) - n // 2) / (n if n % 2 == 0 else n - 1)) for n in shape)
    radius = np.sqrt(y[:, None] ** 2 + x ** 2)
    radius[0, 0] = 1
    low_pass, radial = _low_pass(shape), []
    for scale in range(SCALES):
        centre = 1 / (SHORTEST_WAVE * SCALE_FACTOR ** scale)
        radial.append(np.exp(-np.log(radius / centre) ** 2 / (2 * np.log(BANDWIDTH) ** 2)) * low_pass)
        radial[-1][0, 0] = 0
    theta, band, orientations = np.arctan2(-y[:, None], x), sum(radial), []
    for angle in np.arange(ORIENTATIONS) * np.pi / ORIENTATIONS:
        apart = np.abs(theta - angle)
        angular = np.exp(-np.minimum(apart, 2 * np.pi - apart) ** 2 / (2 * ANGLE_SIGMA ** 2))
        # Sums of products of the filters' real parts in space are those of their even parts in frequency (Parseval).
        whole = band * angular
        even_power = ((whole + np.roll(whole[::-1, ::-1], (1, 1), axis=(0, 1))) ** 2).sum() / 4
        orientations.append((angle, angular, ((radial[0] * angular) ** 2).sum(), even_power))
    return radial, orientations


def _noise_threshold(finest_amplitude, finest_power, even_power):
    """Energy that noise alone reaches, estimated from the finest scale, where most pixels show only noise."""
    noise = np.median(finest_amplitude ** 2) / np.log(2) / finest_power
    tau = np.sqrt(noise * even_power)
    return (tau * np.sqrt(np.pi / 2) + NOISE_SIGMAS * np.sqrt((2 - np.pi / 2) * tau ** 2)) / NOISE_REDUCTION


def _energy(responses):
    """Sum over the scales of each response's part along the mean phase, less the size of its part across it. responses:
    complex, H x W for each scale."""
    total = sum(responses)
    conjugate = (total / (np.abs(total) + EPS)).conj()
    energy, along, across = np.zeros(total.shape), np.empty_like(total), np.empty(total.shape)
    for response in responses:
        np.multiply(response, conjugate, out=along)
        energy += along.real
        energy -= np.abs(along.imag, out=across)
    return energy


def phase_congruency(gray):
    """3 x H x W: phase congruency (0..1) of an H x W gray image, its greatest and its least moment; Kovesi, "Image features
    from phase congruency", Videre 1(3), 1999, with log-Gabor filters."""
    radial, orientations = _filters(gray.shape)
    spectrum = fft2(np.float64(gray))
    energies, amplitudes, xx, xy, yy = np.zeros((5,) + gray.shape)
    for angle, angular, *powers in orientations:
        oriented = spectrum * angular
        responses = [ifft2(oriented * along, overwrite_x=True) for along in radial]
        amplitude = [np.abs(response) for response in responses]
        amplitude_sum = sum(amplitude)
        energy = np.maximum(_energy(responses) - _noise_threshold(amplitude[0], *powers), 0)
        width = amplitude_sum / (functools.reduce(np.maximum, amplitude) + EPS) / SCALES
        energy /= 1 + np.exp(WIDTH_GAIN * (WIDTH_CUT_OFF - width))
        energies += energy
        amplitudes += amplitude_sum
        congruency = ratio(energy, amplitude_sum)
        x, y = congruency * np.cos(angle), congruency * np.sin(angle)
        xx += x * x
        xy += x * y
        yy += y * y
    a, b, c = xx * 2 / ORIENTATIONS, xy / ORIENTATIONS, yy * 2 / ORIENTATIONS
    root = np.sqrt(b ** 2 + (a - c) ** 2) + EPS
    return np.array([energies / (amplitudes + EPS), (a + c + root) / 2, (a + c - root) / 2])
