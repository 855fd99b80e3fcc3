"""Calibration targets: chessboards, ChArUco boards, grids of circles."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "boards": ["CharucoBoard", "Chessboard", "parse_target"],
        "circle_grid": ["CircleGrid"],
    },
)
