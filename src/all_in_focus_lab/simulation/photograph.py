# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Scenes made of a sharp photograph and its depth map, cut into layers: blur then shows what lies behind near objects."""
import cv2
import numpy as np
import skimage.data

from all_in_focus.files.rig import Camera
from all_in_focus.files.stack import size_text
from all_in_focus.imaging import fill_from_farther, srgb_to_linear
from all_in_focus_lab.simulation.depth_sensor import KinectModel
from all_in_focus_lab.simulation.layered_scene import LayeredScene, canvas_margin, kinect_beside
from all_in_focus_lab.simulation.lens import Layer, blur_circle_px

INVENTED = 0.01           # weight of a colour that was invented behind an occluder
BLUR_PER_LAYER_PX = 0.75  # where affordable
SENSOR_WIDTH_MM = 36.0    # of a camera of which only the lens is known


def peel_layers(color, depth, step, reach):
    """Cut one view with a depth map into layers, back to front.

    color: H x W x 3 linear; depth: H x W mm; step: thickness of a layer in 1/mm; reach: by how many pixels each
    layer is continued behind nearer ones, in the colour of its nearest known pixel, at most halfway towards a farther
    layer. Without this, all layers of a slanted object would end at its outline, and each would hide what is behind it.
    """
    inverse_depth = 1 / depth
    slab = np.floor((inverse_depth - inverse_depth.min()) / step).astype(np.int32)
    layers = []
    for value in np.unique(slab):
        own = slab == value
        distance, label = cv2.distanceTransformWithLabels((~own).astype(np.uint8), cv2.DIST_L2, 5,
                                                          labelType=cv2.DIST_LABEL_PIXEL)
        source = np.zeros(label.max() + 1, np.int64)
        source[label[own]] = np.flatnonzero(own)
        nearest = source[label]
        farther = slab < value
        to_farther = cv2.distanceTransform((~farther).astype(np.uint8), cv2.DIST_L2, 5) if farther.any() else np.inf
        hidden = (slab > value) & (distance <= np.minimum(reach, to_farther))
        filled = color.reshape(-1, 3)[nearest]
        filled = np.where(hidden[..., None], cv2.GaussianBlur(filled, (0, 0), 2), filled)
        layers.append(Layer(filled, (own | hidden).astype(np.float32), depth.reshape(-1)[nearest],
                            own + np.float32(INVENTED) * hidden))
    return layers


def photograph(name, image, depth, focal_px, center, size, optics):
    """Scene of an 8-bit RGB image with depth (float32 mm, > 0), pinhole focal_px and principal point center (pixels).

    Other sizes (width, height): scaled to cover, then cropped about the middle.
    """
    width, height = size
    scale = max(width / image.shape[1], height / image.shape[0])
    if scale != 1:
        full = (max(width, round(image.shape[1] * scale)), max(height, round(image.shape[0] * scale)))
        image = cv2.resize(image, full, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC)
        depth = cv2.resize(depth, full, interpolation=cv2.INTER_NEAREST)
    x, y = (image.shape[1] - width) // 2, (image.shape[0] - height) // 2
    image, depth = image[y:y + height, x:x + width], depth[y:y + height, x:x + width]
    color = Camera.pinhole("dslr", width, height, focal_px * scale, focal_px * scale,
                           (center[0] + 0.5) * scale - 0.5 - x, (center[1] + 0.5) * scale - 0.5 - y)
    rig = kinect_beside(color, optics)

    near, far = depth.min(), depth.max()
    mx, my = margin = canvas_margin(rig, max(near, KinectModel.min_range_mm))
    image = cv2.copyMakeBorder(image, my, my, mx, mx, cv2.BORDER_REFLECT_101)
    depth = cv2.copyMakeBorder(depth, my, my, mx, mx, cv2.BORDER_REPLICATE)
    widest = max(blur_circle_px(optics, color.K[0, 0], u, s) for u, s in ((near, far), (far, near)))
    layers = int(np.clip(np.ceil(widest / BLUR_PER_LAYER_PX), 4, 24))
    # A little more than a share, so that the nearest pixel falls into the last layer; flat depth is one layer.
    step = max(1 / near - 1 / far, 1e-9) / layers * 1.0001
    return LayeredScene(name, rig, margin, peel_layers(srgb_to_linear(image), depth, step, widest + 2))


def motorcycle(size, optics, _seed):
    """Middlebury's motorcycle as scikit-image ships it, 2.1 to 5 m."""
    left, _, disparity = skimage.data.stereo_motorcycle()
    focal, cx, cy, doffs, baseline_mm = 994.978, 311.193, 254.877, 31.086, 193.001  # from its docstring
    known = np.isfinite(disparity) & (disparity > -doffs)
    depth = np.where(known, focal * baseline_mm / (np.where(known, disparity, 0) + doffs), 0)
    return photograph("motorcycle", left, fill_from_farther(depth).astype(np.float32), focal, (cx, cy), size, optics)


def measured(image, depth, focal_px, size, optics, _seed):
    """Scene of any sharp picture (8-bit RGB) with registered depth (uint16 mm, 0 = unknown) of the same size.

    focal_px: None for that of the lens before a full-frame sensor. The principal point is the middle.
    """
    if image.shape[:2] != depth.shape:
        raise ValueError(f"picture and depth differ in size: {size_text(image)} and {size_text(depth)}")
    if not depth.any():
        raise ValueError("the depth map is empty")
    height, width = depth.shape
    filled = fill_from_farther(fill_from_farther(depth).T).T.astype(np.float32)  # rows; then columns, for rows without any depth
    focal_px = focal_px or width * optics.focal_length_mm / SENSOR_WIDTH_MM
    return photograph("picture", image, filled, focal_px, ((width - 1) / 2, (height - 1) / 2), size, optics)
