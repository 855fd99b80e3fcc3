"""Flames behind windows, past hardware, by mirrors, through open apertures and absorbing gas."""
