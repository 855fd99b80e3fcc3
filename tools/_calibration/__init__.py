"""The study of calibration: rendered boards with known truth, and what is made of them."""
