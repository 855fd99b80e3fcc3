"""The experiments of arXiv 2010.00893, Pan, Li, Xu: a weight encode reconstruction network.

The rows (`rows`) are trained one by one (`training`) on images of known flames (`cases`), and say
which claims hold (`claims`). The flames are this project's phantoms, not the paper's data.
"""
