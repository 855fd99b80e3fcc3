"""Parts of refinement_study.py: disturbed rigs, the real plume, the page."""
