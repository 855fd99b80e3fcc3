"""Films of volumes: pictures of a size and scale that stay, for pages and for video."""
