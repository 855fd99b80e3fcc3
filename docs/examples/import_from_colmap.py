"""
Import from COLMAP or nerfstudio, and set the scale
===================================================

I have poses from COLMAP or nerfstudio. Where is my nozzle in them, and how long is a millimetre?
Such files know neither: their world has its own axes and its own unit. Four marks whose places are
known, clicked in the images, give both. The picture shows the cameras before and after.

:doc:`/reference/rig_formats` lists all formats, :doc:`/guide/your_cameras` has the command.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.spatial.transform import Rotation

import rigs
from rigs.geometry.rotation import motion_between

# a known rig in mm, as structure from motion may give it: turned, moved, unscaled
true = rigs.ring(8, 30, distance=600, image_size=(640, 480), footprint=0.25, pitch_degrees=15)
turn = Rotation.from_euler("xyz", [20, 50, 10], degrees=True).as_matrix()
theirs = true.with_lengths_scaled(1 / 173).transformed(turn, (1.2, -0.4, 3.0))
rigs.formats.save(theirs, "sparse", "colmap")  # cameras.txt, images.txt, points3D.txt
rigs.formats.save(theirs, "transforms.json")  # nerfstudio: other axes, half-pixel centres

# marks at known places in the lab (mm), and where you clicked them in the images, to 0.3 pixel
marks = np.array([[0, 0, 0], [40, 0, 0], [0, 40, 0], [0, 0, 40]])
clicks = np.stack([camera.project(marks)[0] for camera in true])
clicks += np.random.default_rng(0).normal(0, 0.3, clicks.shape)

figure, (before, after) = plt.subplots(1, 2, figsize=(11, 5.4), layout="constrained")
for path, colour, marker in (("sparse", "#1b6fb0", "o"), ("transforms.json", "#c8511b", "x")):
    rig = rigs.formats.load(path)
    rays = [camera.rays(uv) for camera, uv in zip(rig, clicks, strict=True)]
    through = np.stack(rays, axis=2).swapaxes(0, 1)  # (marks, origins and directions, cameras, 3)
    points = np.stack([rigs.nearest_point(*one)[0] for one in through])  # where rays meet
    R, t, scale = motion_between(points, marks, rescale=True)
    lab = rig.with_lengths_scaled(scale).transformed(R, t)
    off = [np.linalg.norm(c.position - true[c.name].position) for c in lab]
    print(f"{path}: one unit is {scale:.2f} mm; cameras within {max(off):.2f} mm of the truth")
    for axes, shown in ((before, rig), (after, lab)):
        x, _, z = np.transpose([camera.position for camera in shown])
        axes.plot(x, z, marker, color=colour, mfc="none", ms=9, mew=2, label=path)
x, _, z = np.transpose([camera.position for camera in true])
after.plot(x, z, "k.", ms=5, label="the truth")
for axes, places in ((before, points), (after, marks)):
    axes.plot(*places[:, [0, 2]].T, "s", color="#178060", ms=5, label="marks clicked")
before.set(title="as in the files: some axes, some unit", xlabel="x (unit)", ylabel="z (unit)")
after.set(title="by four marks: the lab's axes, in mm", xlabel="x (mm)", ylabel="z (mm)")
plt.setp((before, after), aspect="equal")
figure.legend(*after.get_legend_handles_labels(), loc="outside lower center", ncols=4)
figure.suptitle(f"Four clicked marks place every camera within {max(off):.1f} mm", weight="bold")
plt.show()
