"""From a mesh to its mask: camera, rasteriser or OpenGL, silhouettes, pictures."""
