# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The fusion metrics of two sources a, b and the fused image f (H x W uint8) straight from their definitions: slow."""
from collections import Counter
from math import atan, exp, log, log2, pi, sqrt

import numpy as np
from scipy.signal import correlate2d


def stretched(image):
    low, high = int(image.min()), int(image.max())
    return np.array([[int((int(v) - low) / (high - low) * 255 + 0.5) for v in row] for row in image])


def entropy(symbols):
    return -sum(n / len(symbols) * log2(n / len(symbols)) for n in Counter(symbols).values())


def mutual(one, other):
    """Mutual information and the sum of the entropies, bits."""
    x, y = one.ravel().tolist(), other.ravel().tolist()
    return entropy(x) + entropy(y) - entropy(list(zip(x, y))), entropy(x) + entropy(y)


def q_mi(a, b, f):
    a, b, f = map(stretched, (a, b, f))
    return 2 * sum(np.divide(*mutual(source, f)) for source in (a, b))


def q_ncie(a, b, f):
    a, b, f = map(stretched, (a, b, f))
    ab, af, bf = (mutual(*pair)[0] / 8 for pair in ((a, b), (a, f), (b, f)))
    eigenvalues = np.linalg.eigvals(np.array([[1, ab, af], [ab, 1, bf], [af, bf, 1]]))
    return 1 + sum(value / 3 * log(value / 3, 256) for value in eigenvalues)


def sobel(image):
    """Magnitude and angle of every pixel."""
    kernel = np.array([[-1, 0, 1], [-2, 0, 2], [-1, 0, 1]])
    padded = np.pad(image.astype(int), 1)
    result = {}
    for i, j in np.ndindex(image.shape):
        dx, dy = (int((padded[i:i + 3, j:j + 3] * k).sum()) for k in (kernel, kernel.T))
        result[i, j] = sqrt(dx * dx + dy * dy), atan(dy / (dx or 1e-5))
    return result


def q_g(a, b, f):
    a, b, f = map(sobel, (a, b, f))
    total = 0
    for at in f:
        scores, weights = [], []
        for source in (a, b):
            (g, angle), (fused, fused_angle) = source[at], f[at]
            strength = (fused or 1e-5) / (g or 1e-5)
            strength = min(strength, 1 / strength)
            delta = abs(abs(angle - fused_angle) - pi / 2) * 2 / pi
            scores.append(1 / (1 + exp(-10 * (strength - 0.5))) / (1 + exp(-20 * (delta - 0.75))))
            weights.append(g or 1e-5)
        total += np.average(scores, weights=weights)
    return total / len(f)


def window(size, sigma):
    y, x = np.mgrid[:size, :size] - size // 2
    values = np.exp(-(x ** 2 + y ** 2) / (2 * sigma ** 2))
    return values / values.sum()


def moments(x, y, weights):
    """Weighted means, variances and covariance of two windows."""
    mx, my = (x * weights).sum(), (y * weights).sum()
    return (mx, my, (weights * (x - mx) ** 2).sum(), (weights * (y - my) ** 2).sum(),
            (weights * (x - mx) * (y - my)).sum())


def q_y(a, b, f):
    weights, c, values = window(7, 1.5), 2e-16, []

    def similarity(x, y):
        mx, my, vx, vy, cov = moments(x.astype(float), y.astype(float), weights)
        vx, vy = (0 if np.ptp(p) == 0 else v for p, v in ((x, vx), (y, vy)))
        cov = 0 if 0 in (vx, vy) else cov
        return (2 * mx * my + c) * (2 * cov + c) / ((mx * mx + my * my + c) * (vx + vy + c)), vx, vy

    for i, j in np.ndindex(a.shape[0] - 6, a.shape[1] - 6):
        pa, pb, pf = (image[i:i + 7, j:j + 7] for image in (a, b, f))
        if not (pa.any() or pb.any()):
            continue
        (ab, va, vb), af, bf = similarity(pa, pb), similarity(pa, pf)[0], similarity(pb, pf)[0]
        share = va / (va + vb) if va + vb else 0.5
        values.append(share * af + (1 - share) * bf if ab >= 0.75 else max(af, bf))
    return np.mean(values)


def contrast(image):
    image = stretched(image)
    rows, columns = image.shape
    fy, fx = (2 * (np.arange(n) - n // 2) / n * n / 30 for n in image.shape)
    r = np.hypot(fy[:, None], fx)
    eye = np.exp(-(r / 15.3870) ** 2) - 0.7622 * np.exp(-(r / 1.3456) ** 2)
    seen = np.real(np.fft.ifft2(np.fft.fft2(image) * np.fft.ifftshift(eye)))
    y, x = np.mgrid[-15:16, -15:16]
    near, far = (correlate2d(seen, np.exp(-(x * x + y * y) / (2 * s * s)) / (2 * pi * s * s), "same") for s in (2, 4))
    value = np.abs(near / far - 1)
    return value ** 3 / (value ** 2 + 1e-4)


def q_cb(a, b, f):
    ca, cb, cf = map(contrast, (a, b, f))
    scores = [np.where(c < cf, c / cf, cf / c) for c in (ca, cb)]
    return ((ca ** 2 * scores[0] + cb ** 2 * scores[1]) / (ca ** 2 + cb ** 2)).mean()


def phase_maps(image):
    """Phase congruency and its two moments, with filters in space for the noise."""
    rows, columns = image.shape
    y, x = ((np.arange(n) - n // 2) / (n - n % 2) for n in image.shape)
    y, x = y[:, None], x[None]
    r, theta = np.hypot(y, x), np.arctan2(-y, x + 0 * y)
    r[rows // 2, columns // 2] = 1
    ly, lx = ((np.arange(n) - n // 2) / n for n in image.shape)
    low = np.fft.fftshift(1 / (1 + (np.hypot(ly[:, None], lx) / 0.45) ** 30))
    spectrum, eps = np.fft.fft2(image), 1e-4
    energy_sum = amplitude_sum = a = b = c = 0
    for angle in np.arange(6) * pi / 6:
        d = np.abs(np.arctan2(np.sin(theta) * np.cos(angle) - np.cos(theta) * np.sin(angle),
                              np.cos(theta) * np.cos(angle) + np.sin(theta) * np.sin(angle)))
        filters = []
        for scale in range(4):
            radial = np.fft.ifftshift(np.exp(-np.log(r * 3 * 2.1 ** scale) ** 2 / (2 * np.log(0.55) ** 2))) * low
            radial[0, 0] = 0
            filters.append(radial * np.fft.ifftshift(np.exp(-d ** 2 / (2 * (pi / 6 / 1.2) ** 2))))
        e = [np.fft.ifft2(spectrum * one) for one in filters]
        amplitudes = [np.abs(one) for one in e]
        even, odd = sum(e).real, sum(e).imag
        norm = np.sqrt(even ** 2 + odd ** 2) + eps
        even, odd = even / norm, odd / norm
        energy = sum(one.real * even + one.imag * odd - np.abs(one.real * odd - one.imag * even) for one in e)
        h = [np.real(np.fft.ifft2(one)) * sqrt(rows * columns) for one in filters]
        power = np.median(amplitudes[0] ** 2) / log(2) / (filters[0] ** 2).sum()
        noise = sum((2 if s == t else 4) * power * (h[s] * h[t]).sum() for s in range(4) for t in range(s, 4))
        tau = sqrt(noise / 2)
        energy = np.maximum(energy - (tau * sqrt(pi / 2) + 2 * sqrt((2 - pi / 2) * tau ** 2)) / 1.7, 0)
        width = sum(amplitudes) / (np.max(amplitudes, axis=0) + eps) / 4
        energy = energy / (1 + np.exp(10 * (0.5 - width)))
        energy_sum, amplitude_sum = energy_sum + energy, amplitude_sum + sum(amplitudes)
        px, py = (energy / sum(amplitudes) * turn(angle) for turn in (np.cos, np.sin))
        a, b, c = a + px ** 2 / 3, b + px * py / 6, c + py ** 2 / 3
    root = np.sqrt(b ** 2 + (a - c) ** 2) + eps
    return energy_sum / (amplitude_sum + eps), (a + c + root) / 2, (a + c - root) / 2


def q_p(a, b, f):
    of_a, of_b, of_f = map(phase_maps, (a, b, f))
    from_a = of_a[0] > of_b[0]
    sources = [of_a, of_b, [np.where(from_a, x, y) for x, y in zip(of_a, of_b)]]
    masks = [maps[0] > 0.1 for maps in sources]
    weights, product = window(11, 1.5), 1
    for kind in range(3):
        total = 0
        target = np.pad(of_f[kind], 5)
        padded = [np.pad(maps[kind] * mask, 5) for maps, mask in zip(sources, masks)]
        for i, j in np.ndindex(a.shape):
            scores = []
            for source, mask in zip(padded, masks):
                _, _, vx, vy, cov = moments(source[i:i + 11, j:j + 11], target[i:i + 11, j:j + 11], weights)
                scores.append((cov + 1e-4) / (sqrt(vx * vy) + 1e-4) if mask[i, j] else 0)
            total += max(scores)
        product *= total / masks[2].sum()
    return product
