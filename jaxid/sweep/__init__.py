"""Many closed loops at once: grids of motions, gains and plants, resumable, on many devices."""
