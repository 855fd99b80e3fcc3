"""Formats of films, a module each; `rigs.recordings.films` has the table of them."""
