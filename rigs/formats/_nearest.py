"""Which format a file that is in none comes nearest to, and what it lacks."""

from __future__ import annotations

import re
from collections.abc import Mapping

#: Words that every file of a format holds.
FIELDS = {
    "multical": "cameras camera_poses model image_size dist",
    "kalibr": "cam0 camera_model intrinsics distortion_model resolution",
    "anipose": "size matrix distortions rotation translation",
    "mrcal": "lensmodel extrinsics intrinsics imagersize",
    "metashape": "document chunk sensors cameras camera",
    "gaussian_splatting": "img_name width height position rotation fx fy",
    "alicevision": "version views intrinsics poses viewId intrinsicId",
    "opensfm": "cameras projection_type shots rotation translation",
    "qualisys": "calibration cameras fov_video transform focalLengthU",
    "kitti": "S_00 K_00 D_00 R_00 T_00",
    "camera_table": "name x y z look_x look_y look_z",
    "realitycapture": "name x y alt heading pitch roll f",
    "pix4d": "fileName imageWidth imageHeight camera matrix K radial",
}


def nearest(head: str, about: Mapping[str, str]) -> str:
    """Return the end of a message: the format with most of its fields in a file, and the others.

    Parameters
    ----------
    head : str
        The beginning of the file.
    about : mapping of str to str
        What each format is.
    """
    words = set(re.findall(r"\w+", head))
    missing = {name: [w for w in own.split() if w not in words] for name, own in FIELDS.items()}
    share = {name: 1 - len(lost) / len(FIELDS[name].split()) for name, lost in missing.items()}
    best = max(share, key=lambda name: share[name])
    if share[best] < 1 / 2:  # with less than half, any file is like some format
        return ""
    lacks = f"lacks {', '.join(missing[best])}" if missing[best] else f"try --from {best}"
    return f"; nearest is {best} ({about[best]}): {lacks}"
