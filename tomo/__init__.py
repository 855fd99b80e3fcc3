"""Camera-based 3-D emission tomography: from images to the emission in every voxel.

The nouns:

- `VoxelGrid`: where the voxels are: shape, spacing, centre.
- `Volume`: the values of the voxels, an array that knows its grid: ``sample``, ``profile``,
  ``project``, ``area``, ``total``, ``crop``, ``resample``. `mean_and_rms` is over a film.
- `Scan`: the images of a rig's cameras (`rigs.Rig`), of one moment or a film. `load_scan` reads a
  folder, `scan_of_images` images beside a rig, `Scan.from_arrays` takes arrays, and `simulate`
  makes one of a known emission (`phantoms`).
- `Options`: everything that can be asked of a reconstruction; ``help(tomo.Options)`` is its
  reference.
- `Reconstruction`: what `reconstruct` returns: ``volume``, ``answer``, ``report()``,
  ``save(folder)``, ``to_xarray()``. A notebook shows it.
- `preview`: a coarse one in seconds, by `Options.quick`.
- `SeriesStore`: the volumes of a film, by `reconstruct_series`; `export_series` writes them for
  other programs.
- `tomo.draw`: ``visualize_rig``, ``visualize_volume``, ``visualize_check``, ``visualize_film``.

For own methods: `Rays`, `trace` and `Segments`, the operators (`Projector`, `LinearSystem`) and
`tomo.solvers`.

Examples
--------
A flame, its images, and the volume that they give back:

>>> import phantoms, rigs, tomo
>>> grid = tomo.VoxelGrid(shape=(8, 16, 8), spacing=1.0)
>>> rig = rigs.ring(6, distance=500, image_size=(24, 36), footprint=0.6, pitch_degrees=10)
>>> flame = phantoms.create("jet", extent=grid.extent)
>>> scan = tomo.simulate(rig, flame, grid)
>>> result = tomo.reconstruct(scan, options=tomo.Options(method="mlem", iterations=30))
>>> result.volume.shape
(8, 16, 8)
>>> bool(result.report()["relative_residual"] < 0.2)
True

``progress=True`` shows a bar in a terminal and in a notebook; by default nothing is printed.

Go on with ``help(rigs)`` for cameras and calibration, ``help(phantoms)`` for known emissions, and
the page "From Python" of the documentation, which has each command beside its lines of Python.

Names are loaded on first use, so that ``import tomo`` costs nothing that is not needed.
"""

from rigs.lazy_names import attach

__getattr__, __dir__, __all__ = attach(
    __name__,
    submodules=[
        "draw",
        "export",
        "io",
        "metrics",
        "operators",
        "radiometry",
        "report",
        "series",
        "simulation",
        "solvers",
        "view",
        "wernet",
    ],
    submod_attrs={
        "export": ["export_series"],
        "grid": ["ActiveVoxels", "Volume", "VoxelGrid", "mean_and_rms"],
        "operators": ["LinearSystem", "Projector", "GaussianBasis", "dot_test"],
        "pipeline": ["Options", "Reconstruction", "preview", "reconstruct"],
        "rays": ["Rays"],
        "scan": ["Corrections", "Frame", "Scan", "load_scan", "save_scan", "scan_of_images"],
        "series": ["SeriesStore", "reconstruct_series"],
        "simulation": ["simulate"],
        "solvers": ["Iteration", "Solution"],
        "trace": ["Segments", "trace"],
    },
)
