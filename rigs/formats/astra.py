"""ASTRA's ``cone_vec`` projection geometry: source, detector centre and pixel steps of each view.

Written only, as JSON that holds the dictionary of ``astra.create_proj_geom("cone_vec", rows,
columns, vectors)``: ``type, DetectorRowCount, DetectorColCount, Vectors``; ``cameras`` and
``length_unit`` are added. A row of ``Vectors`` is (source, d, u, v), three numbers each: ``d`` the
detector's centre, ``u`` the step from pixel (row 0, column 0) to (0, 1), ``v`` to (1, 0). The line
of sight of pixel (column, row) runs from the source through::

    d + (column - (columns - 1) / 2) u + (row - (rows - 1) / 2) v

World axes and units are the rig's; ASTRA uses them for the volume's window too. The detector is
put at the depth of the volume's centre (else of the origin). ASTRA has no distortion: cameras
other than pinholes are refused; resample their images first.
https://astra-toolbox.com/docs/geom3d.html
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from rigs.camera_protocol import LensCamera
from rigs.files.text import write_text
from rigs.formats._lens import refuse_lens, refuse_tables
from rigs.rig import Rig


def save(rig: Rig, path: Path) -> None:
    """Write the geometry of a rig of pinholes, all of one image size."""
    cameras = refuse_tables(rig, "ASTRA")
    if not len(rig):
        raise ValueError("cameras: found none, expected at least one")
    center = np.array(rig.volume.center if rig.volume else (0.0, 0.0, 0.0))
    columns, rows = rig[0].image_size
    vectors = []
    for camera in cameras:
        if camera.image_size != (columns, rows):
            raise ValueError(
                f"camera {camera.name}: image_size: found {camera.image_size}, expected "
                f"{(columns, rows)} as for camera {rig[0].name}: ASTRA has one detector size"
            )
        vectors.append(vector(camera, center))
    data = {
        "type": "cone_vec",
        "DetectorRowCount": rows,
        "DetectorColCount": columns,
        "Vectors": vectors,
        "cameras": list(rig.names),
        "length_unit": rig.length_unit,
    }
    write_text(path, json.dumps(data, indent=1, ensure_ascii=False) + "\n")


def vector(camera: LensCamera, center: np.ndarray) -> list[float]:
    """Return the twelve numbers of a pinhole; the detector is at the depth of ``center``."""
    if any(camera.distortion.coefficients):
        refuse_lens(camera, "ASTRA")
    depth = float(camera.R[2] @ center + camera.t[2])
    depth = depth if depth > 0 else 1.0
    columns, rows = camera.image_size
    # columns of the inverse: the pixel steps and the image's middle, at that depth
    inverse = camera.R.T @ np.linalg.inv(camera.camera_matrix) * depth
    middle = inverse @ [(columns - 1) / 2, (rows - 1) / 2, 1.0]
    source = camera.position
    return [*source.tolist(), *(source + middle).tolist(), *inverse[:, 0], *inverse[:, 1]]
