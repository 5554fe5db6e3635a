"""Where meshes come from: places, archives, layouts and the readers of mesh files."""
