#!/bin/sh
# Sets up .venv, reconstructs a simulated flame, shows what learning buys, and draws every picture.
. "$(dirname -- "$0")/_setup.sh"

out=out/demo
flametomo=.venv/bin/flametomo

say "== simulate: a turbulent flame in front of 33 cameras"
# 3 x 3 rays a pixel and voxels half as wide as those reconstructed: no inverse crime
$flametomo simulate --rig paper33_pitch --phantom turbulent \
    --supersample 3 --refine 2 --seed 1 -o "$out/scan"

say "== reconstruct it"
$flametomo reconstruct "$out/scan" -o "$out"

say "== learn optics that no formula has: a small flame behind filters with fringes"
# the example of the gallery, its figure written to a file in place of a window
MPLBACKEND=agg .venv/bin/python -c "import runpy, sys; import matplotlib.pyplot as plt
runpy.run_path(sys.argv[1]); plt.savefig(sys.argv[2])" \
    docs/examples/wernet_learns_optics.py "$out/learned.png"

say "== draw the rig with the volume, and the volume"
$flametomo visualize-rig "$out/scan/rig.yaml" --volume "$out/volume.npz" \
    -o "$out/rig.png" -o "$out/rig.html" -o "$out/rig.glb"
$flametomo visualize-volume "$out/volume.npz" \
    -o "$out/flame.png" -o "$out/flame.html" -o "$out/flame.glb"

say "done; open these:"
for file in report.html learned.png rig.html flame.html rig.png flame.png rig.glb report.json \
    volume.vti; do
    say "  $out/$file"
done
