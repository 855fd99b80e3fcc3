#!/bin/sh
# Sets up .venv, reconstructs a simulated flame by two methods, and draws every kind of picture.
. "$(dirname -- "$0")/_setup.sh"

out=out/demo
flametomo=.venv/bin/flametomo

say "== simulate: a turbulent flame in front of 33 cameras"
# 3 x 3 rays a pixel and voxels half as wide as those reconstructed: no inverse crime
$flametomo simulate --rig paper33_pitch --phantom turbulent \
    --supersample 3 --refine 2 --seed 1 -o "$out/scan"

say "== reconstruct it, also by the network of the WERNet paper"
$flametomo reconstruct "$out/scan" -o "$out" --compare wernet-paper:3

say "== draw the rig with the volume, and the volume"
for kind in png html glb; do
    $flametomo visualize-rig "$out/scan/rig.yaml" --volume "$out/volume.npz" -o "$out/rig.$kind"
    $flametomo visualize-volume "$out/volume.npz" -o "$out/flame.$kind"
done

say "done; open these:"
for file in report.html rig.html flame.html rig.png flame.png rig.glb report.json volume.vti; do
    say "  $out/$file"
done
