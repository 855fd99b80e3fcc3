#!/bin/sh
# Sets up .venv, simulates the images of a turbulent flame, reconstructs it and draws pictures.
. "$(dirname -- "$0")/_setup.sh"

out=out/demo
python=.venv/bin/python

say "== simulate: a turbulent flame in front of 33 cameras"
# 3 x 3 rays a pixel and voxels half as wide as those reconstructed: no inverse crime
$python tools/simulate.py --rig paper33_pitch --phantom turbulent \
    --supersample 3 --refine 2 --seed 1 -o "$out/scan"

say "== reconstruct it"
$python tools/reconstruct.py "$out/scan" -o "$out" --compare wernet-paper:3

say "== draw the rig with the volume, and the volume"
for kind in png html glb; do
    $python tools/visualize_rig.py "$out/scan/rig.yaml" --volume "$out/volume.npz" -o "$out/rig.$kind"
    $python tools/visualize_volume.py "$out/volume.npz" -o "$out/flame.$kind"
done

say "done; open these:"
for file in report.html rig.html flame.html rig.png flame.png rig.glb report.json volume.vti; do
    say "  $out/$file"
done
