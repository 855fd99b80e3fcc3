"""The images that cameras wrote, read as stored: linear, row 0 first."""
