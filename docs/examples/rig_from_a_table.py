"""
A rig from a table of positions
===============================

I measured where my cameras stand and know their lenses. How do I make a rig of that? A row of a
table becomes a camera: where it stands, the point that it looks at, focal length and pixel pitch.
The picture shows whether the cameras stand and look where you think they do.

Such a rig is good for planning. For a measurement, calibrate: :doc:`/guide/your_cameras`.
"""

import csv

import matplotlib.pyplot as plt

import rigs
from tomo.draw import visualize_rig

TABLE = """\
name,      x,   y,    z, look_x, look_y, look_z, focal_mm, pitch_um, width, height
left,   -380,  40,  420,      0,     10,      0,       35,      5.5,  1024,   1280
front,     0,  40,  560,      0,     10,      0,       35,      5.5,  1024,   1280
right,   380,  40,  420,      0,     10,      0,       35,      5.5,  1024,   1280
side,    600, -60,  -20,      0,     10,      0,       50,      6.5,   900,   1100
top,     180, 420, -240,      0,     10,      0,       25,      5.5,  1024,   1280
"""  # lengths in mm, y up

cameras = []
for row in csv.DictReader(TABLE.splitlines(), skipinitialspace=True):
    name = row.pop("name")
    x, y, z, look_x, look_y, look_z, focal, pitch, width, height = map(float, row.values())
    R, t = rigs.look_at((x, y, z), (look_x, look_y, look_z), up=(0, 1, 0))
    f = focal / (pitch / 1000)  # in pixels; pixel centres are at integers
    lens = [[f, 0, (width - 1) / 2], [0, f, (height - 1) / 2], [0, 0, 1]]
    size = (int(width), int(height))
    cameras.append(rigs.Camera(name, size, lens, R=R, t=t, status="nominal"))

flame = rigs.Volume(shape=(50, 80, 50), spacing=1.0, center=(0, 10, 0))
rig = rigs.Rig(tuple(cameras), length_unit="mm", world_frame="nozzle, y up", volume=flame)
rigs.save_rig(rig, "rig.yaml")  # what every command reads
pixels = rig.footprint(flame.center)
cut = [one.name for one in rig if not one.inside(one.project(flame.corners())[0]).all()]
print(f"a pixel is {pixels.min():.3f} to {pixels.max():.3f} mm wide at the flame")
print(f"cameras that see a part of the volume only: {', '.join(cut) or 'none'}")

words = "Does every camera stand and look where you think it does?"
visualize_rig("rig.png", rig, title=words)
plt.figure(figsize=(11, 6)).add_axes((0, 0, 1, 1), frameon=False, xticks=[], yticks=[])
plt.imshow(plt.imread("rig.png"))
plt.show()
