//! Rebuilds the surface from the tiles and proves that it has no hole.
