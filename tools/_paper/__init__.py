"""The studies of ``tools/paper.py``: the experiments of arXiv 2010.00893, one part each."""

PARTS = ("readings", "layouts", "views", "ablation", "normalisation", "denoising", "transfer")
