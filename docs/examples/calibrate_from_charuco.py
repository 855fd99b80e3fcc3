"""
Calibration from images of a ChArUco board
==========================================

I moved a ChArUco board through the volume. How well are my cameras now known, in millimetres?
Detection and calibration are one call each. Residuals in pixels say little of a rig; the ray-miss
does: how far rays that should meet pass each other in the volume. The calibration predicts it, and
here, where the images are drawn from a known rig, the truth confirms the prediction. Expect more
from real images: boards bend, and real lenses are not exactly polynomials.

:doc:`/guide/your_cameras` has the command, and rules for good images.
"""

import cv2
import matplotlib.pyplot as plt
import numpy as np

import rigs
from rigs.calibrate import CharucoBoard, calibrate, observe

board = CharucoBoard(9, 7, 18, 13.5, "DICT_4X4_50")  # squares, mm
true = rigs.arc(3, 60, 700, image_size=(480, 400), footprint=0.5)
paper, corner = board.drawing(3)  # three pixels a mm
to_board = np.array([[1 / 3, 0, corner[0]], [0, 1 / 3, corner[1]], [0, 0, 1]])
finer = np.array([[2, 0, 0.5], [0, 2, 0.5], [0, 0, 1]])  # drawn with 2 x 2 points a pixel

random, images = np.random.default_rng(2), {camera.name: {} for camera in true}
for moment in range(12):  # your board, held in twelve poses before real cameras
    R = np.diag([1, -1, -1]) @ cv2.Rodrigues(random.uniform(-0.4, 0.4, 3))[0]
    t = random.uniform(-25, 25, 3) - R @ [81, 63, 0]
    for camera in true:
        pose = np.c_[camera.R @ R[:, :2], camera.R @ t + camera.t]
        onto = finer @ camera.camera_matrix @ pose @ to_board
        image = cv2.warpPerspective(paper, onto, (960, 800), borderValue=110)
        image = cv2.resize(cv2.blur(image, (3, 3)), (480, 400), interpolation=cv2.INTER_AREA)
        image = (30 + 0.7 * image + random.normal(0, 5, image.shape)).clip(0, 255)
        images[camera.name][f"{moment:03d}"] = image.astype(np.uint8)

observed = observe(images, board)
world = {camera.name: camera.position for camera in true}  # else the first camera's axes
found = calibrate(observed, target=board, world=world, volume=rigs.Volume((40, 40, 40), 2.0))
truth = rigs.compare_rigs(true, found.rig, found.quality.points)
print(found.assessment)

figure, axes = plt.subplot_mosaic("AAB;AAC", figsize=(11, 6.5), layout="constrained")
photo, cloud, miss = axes.values()
photo.imshow(images["cam00"]["000"], "gray")
shown = observed.uv[(observed.camera == 0) & (observed.frame == 0)]
photo.plot(*shown.T, "o", color="tab:orange", mfc="none")
photo.set(title="corners found in one of 36 images", xlabel="column (pixel)", ylabel="row (pixel)")
cloud.plot(*found.residuals.T, ".", ms=3)
cloud.set(title="their residuals", xlabel="to the right (pixel)", ylabel="down (pixel)", aspect=1)
miss.plot(true.names, 1000 * found.quality.camera_ray_miss, "o", ms=10, label="predicted")
actual = [1000 * one.ray_miss for one in truth.cameras]
miss.plot(true.names, actual, "kx", ms=10, label="in truth")
miss.set(title="how far rays miss each other", ylabel="ray-miss (µm)", ylim=(0, None))
miss.legend()
plt.show()
